"""Driver for robots on the middleware YARP, and server that makes any robot available on YARP.

The package `yarpwire` implements YARP's protocol. The modules here are:

- Driver `yarp`, which reads and commands control boards and reads skin ports: `driver`, `board_driver`,
  `diagnose`.
- Server `tci serve --via yarp`, with boards, skin ports and contacts of any robot: `server`, `served_board`,
  `board_modes`, `call_arguments`, `order_book`, `skin_events`.
- Query of a robot's facts, such as DH tables, limits and skin: `facts`.
- Parser of the address, the text after `yarp:` on the command line: `address`.
"""
