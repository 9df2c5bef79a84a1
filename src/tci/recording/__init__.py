"""Recordings: all that passed between robot and behaviour, as MCAP files with ROS 2 messages.

Raw frames are kept as they came, so everything after them can be worked out again, by a replay or by
another behaviour. docs/recordings.md lists the topics.
"""
