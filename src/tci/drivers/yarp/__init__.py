"""YARP on the wire, in pure Python: no YARP build to install.

dialect, values, bottle, text   what is said: 3.x and 4.x number some types differently
message, source                 how it is packed: header, index, command, envelope, acknowledgement
incoming, outgoing, auth        one connection, by its carrier: tcp, fast_tcp, udp, text, text_ack
names, name_server              who is where
port, rpc                       what a program talks through
network                         the same as a driver asks for it: by `wire`, TCI's own, or YARP's own
`bindings` board, state                    iCub's control boards: calls, commands and their state
driver                          `yarp`: a robot behind YARP
server                          `tci serve --via yarp`: a robot shown as YARP control boards and skin ports
"""
