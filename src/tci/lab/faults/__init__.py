"""Fault injection into any driver."""
