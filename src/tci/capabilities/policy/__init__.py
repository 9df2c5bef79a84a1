"""Trained policies as capabilities: what they see, when they act, and the file that says both.

Environments of `tci.learn` see with the same functions, so a policy sees on a robot what it was trained on.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.capabilities.policy.capability import PolicyCapability as PolicyCapability
    from tci.capabilities.policy.capability import PolicyMemory as PolicyMemory
    from tci.capabilities.policy.file import read_policy as read_policy
    from tci.capabilities.policy.file import write_policy as write_policy
    from tci.capabilities.policy.observations import OBSERVATIONS as OBSERVATIONS
    from tci.capabilities.policy.observations import Observation as Observation
    from tci.capabilities.policy.observations import View as View
    from tci.capabilities.policy.spec import Policy as Policy
    from tci.capabilities.policy.spec import PolicySpec as PolicySpec
    from tci.capabilities.policy.spec import Seen as Seen
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
