"""An arm on its way gives way to a person: it presses with no more than a cap, and then goes on."""
