"""The experiments whose figures `tci demo` prints: poke, measure, check, report, draw."""
