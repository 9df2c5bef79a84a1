"""Touches told as words: what kind, where, how firmly, how sure. It moves nothing."""
