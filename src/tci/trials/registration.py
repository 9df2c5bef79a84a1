"""The environment's name for `gymnasium.make`, known without loading the environment."""

from __future__ import annotations

NAME = "tci/Withdrawal-v0"
"""Its name once it is registered. `import tci` does that if Gymnasium is imported already;
`gymnasium.make("tci.trials.withdrawal_env:tci/Withdrawal-v0")` does it in any case."""


def register() -> None:
    """Registers the environment with Gymnasium, once."""
    import gymnasium

    if NAME not in gymnasium.registry:
        gymnasium.register(id=NAME, entry_point="tci.trials.withdrawal_env:WithdrawalEnv")
