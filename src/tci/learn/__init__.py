"""Environments for learning (extra `gym`).

Importing this package registers them with Gymnasium: `gymnasium.make("tci.learn:tci/Withdrawal-v0")`.
"""

from __future__ import annotations

from tci.support.installed import needs

with needs("the environment tci/Withdrawal-v0", "gym"):
    import gymnasium

NAME = "tci/Withdrawal-v0"
"""Name of the environment in Gymnasium's registry."""

gymnasium.register(id=NAME, entry_point=f"{__name__}.withdrawal_env:WithdrawalEnv")
