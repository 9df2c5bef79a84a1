"""XELA uSkin, patches that measure along three axes, through the maker's server."""
