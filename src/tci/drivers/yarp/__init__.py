"""A robot behind YARP, and any robot shown as one. The protocol itself is the package `yarpwire`.

board_driver, driver, diagnose   `yarp`: control boards and skin ports of a robot, read and commanded
served_board, order_book         one part of a robot as a control board
server, skin_events              `tci serve --via yarp`: boards, skin ports and contacts of any robot
address                          what follows `yarp:` on the command line
"""
