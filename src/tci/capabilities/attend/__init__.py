"""The robot looks where it is touched: after it has withdrawn, and as long as a touch moves over its skin."""
