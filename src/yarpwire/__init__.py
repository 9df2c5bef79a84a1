"""YARP in pure Python: ports, calls, a name server and control boards, with no YARP build to install.

It exchanges data with programs of YARP 3.12 and 4.0, as client and as server, and needs nothing but numpy.
README.md begins with five lines that read a port.

dialect, values, bottle, text    types and their encoding: 3.x and 4.x number some of them differently
message, source                  framing: header, index, command, envelope, acknowledgement
incoming, outgoing, auth         one connection, by its carrier: tcp, fast_tcp, udp, text, text_ack
listener, connection_limit       accepting connections, and the bound on their number
names, name_server               the client of a name server, and a name server
port, rpc, feed                  named ports, calls, and the latest messages of another program's port
network, wire, bindings          one interface to ports and calls, by this package or by YARP's own bindings
board, state                     a client of iCub's control boards
board_service, calls_v3, calls_v4, streams    a control board that this process offers
sensors                          skin patches and other sensors of one device, in YARP 4
"""

from yarpwire.dialect import V3, V4, Dialect
from yarpwire.errors import BindingsError, CallError, PortError, UnknownNameError, WireError, YarpError
from yarpwire.feed import Feed
from yarpwire.incoming import Delivery
from yarpwire.message import Stamp
from yarpwire.name_server import NameServer
from yarpwire.names import Names
from yarpwire.port import Port
from yarpwire.rpc import Rpc
from yarpwire.values import Vocab
from yarpwire.wire import Wire

__all__ = [
    "V3",
    "V4",
    "BindingsError",
    "CallError",
    "Delivery",
    "Dialect",
    "Feed",
    "NameServer",
    "Names",
    "Port",
    "PortError",
    "Rpc",
    "Stamp",
    "UnknownNameError",
    "Vocab",
    "Wire",
    "WireError",
    "YarpError",
]
