"""Recordings: all data between robot and behaviour, as MCAP files with ROS 2 messages.

Raw frames are stored unchanged, so all later stages can be computed again, by a replay or by another
behaviour. The page docs/recordings.md lists the topics.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.recording.export import tables as tables
    from tci.recording.perceived import recorded_robot as recorded_robot
    from tci.recording.recorder import Recorder as Recorder
    from tci.recording.recording import RecordedTick as RecordedTick
    from tci.recording.recording import Recording as Recording
    from tci.recording.recording import Topic as Topic
    from tci.recording.rosmsg.cdr import MessageType as MessageType
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
