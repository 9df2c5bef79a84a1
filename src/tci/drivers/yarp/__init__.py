"""Driver of robots on YARP, and server of any robot as a robot on YARP. The protocol itself is the package
`yarpwire`.

driver, board_driver, diagnose   `yarp`: reads and commands control boards, and reads skin ports
server, served_board, board_modes, call_arguments, order_book, skin_events   `tci serve --via yarp`: boards,
skin ports and contacts of any robot
facts                            the run-time query: DH tables, limits, skin
address                          parses the address, the text after `yarp:` on the command line
"""
