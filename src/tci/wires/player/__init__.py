"""Client and server for the robot middleware Player 3 over TCP (Gerkey, Vaughan, Howard 2003).

The joints of a robot part are a device of Player's interface actarray. A skin patch is a device of the
interface opaque.
"""
