"""The experiments whose results `tci demo` and `tci check` print.

Each pokes simulated robots at known places, with and without a reflex, and measures their response. The
`checker` compares every command sent with the limits of the description and shares no code with the gate.
"""
