"""YARP in pure Python: ports, calls, a name server and control boards, with no YARP build to install.

yarpwire exchanges data with programs of YARP 3.12 and 4.0, as client and as server. It needs only numpy. The
first example in README.md reads a port in five lines.

- `dialect`, `values`, `bottle`, `text`: types and their encoding, which differ between YARP 3.x
  and 4.x.
- `message`, `source`: format of messages as bytes.
- `incoming`, `outgoing`, `auth`: one connection, with the carrier tcp, fast_tcp, udp, text or text_ack.
- `listener`, `connection_limit`: accepts connections, and bounds their number.
- `names`, `name_server`: client of a name server, and a name server.
- `port`, `rpc`, `feed`: named ports, calls, and the latest messages of another program's port.
- `network`, `wire`, `bindings`: common interface to ports and calls, in pure Python or with YARP's
  bindings.
- `board`, `state`: client of iCub's control boards.
- `board_service`, `calls_v3`, `calls_v4`, `streams`: a control board that this process offers.
- `sensors`: skin patches and other sensors of a device in YARP 4.
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
