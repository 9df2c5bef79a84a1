"""What is said of a contact."""

from __future__ import annotations

import pytest

from tci.messages import Met


@pytest.mark.parametrize(
    ("force", "joint", "behind", "words"),
    [
        (20.0, "elbow", 0.0, "left_arm met something: 20 N on its skin; it goes back"),
        (0.2, "elbow", 0.0, "left_arm met something: elbow bears more than a moment ago; it goes back"),
        (20.0, "elbow", 0.1, "left_arm met something: elbow is held 5.7 degrees behind; it goes back"),
        (0.2, None, 0.0, "left_arm met something; it goes back"),
    ],
)
def test_only_what_tells_of_it_is_said(force: float, joint: str | None, behind: float, words: str) -> None:
    assert str(Met("left_arm", force, joint, behind, "retreat")) == words
