"""What several wires use: DDS, sockets of a process, a gate for connections that reach only some joints."""
