"""Recordings: all data between robot and behaviour, as MCAP files with ROS 2 messages.

Raw frames are stored unchanged, so all later stages can be computed again, by a replay or by another
behaviour. The page docs/recordings.md lists the topics.
"""
