"""The experiments whose figures `tci demo` and `tci check` print.

Each pokes simulated robots at known places, with and without a reflex, and measures what came of it. The
checker judges every sent command by the description alone and shares nothing with the gate.
"""
