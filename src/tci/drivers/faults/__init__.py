"""Faults on purpose, around any driver."""
