"""Sweeps: thousands of trials on all cores, in shards on many machines, or on a cluster."""
