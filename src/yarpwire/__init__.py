"""YARP on the wire, in pure Python: no YARP build to install.

dialect, values, bottle, text    what is said: 3.x and 4.x number some types differently
message, source                  how it is packed: header, index, command, envelope, acknowledgement
incoming, outgoing, auth         one connection, by its carrier: tcp, fast_tcp, udp, text, text_ack
listener, visitors               connections that others make, and how many
names, name_server               who is where
port, rpc, feed                  what a program talks through
network, wire, bindings          the same by our own wire, or by YARP's own Python bindings
board, state, calls_v3, calls_v4, streams    iCub's control boards: calls, commands and their state
"""
