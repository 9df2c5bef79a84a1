"""Recordings as data sets that policies train on.

A recording is an episode; `episodes` turns recordings into columns with one row per frame of the set, and a
module per format writes them (`lerobot`).
"""
