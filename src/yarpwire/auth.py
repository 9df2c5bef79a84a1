"""YARP's authentication: each end proves that it has the key in `auth.conf`. Data is not encrypted.

A is the end that accepted the connection, B the end that opened it. n1, n2 and n3 are random numbers of 8
bytes, and mac is HMAC-SHA256 with the key.

- A sends n1 and mac(n1).
- B sends n2 and mac(n1 n2).
- A sends n3 and mac(n1 n2 n3).
"""

from __future__ import annotations

import hmac
import secrets
import socket

from yarpwire.errors import WireError
from yarpwire.source import SocketSource

NONCE, DIGEST = 8, 32


def accept(sock: socket.socket, source: SocketSource, key: bytes) -> None:
    """Authenticates at the end that accepted the connection. Raises WireError if the other end lacks the
    key."""
    first = secrets.token_bytes(NONCE)
    sock.sendall(first + _mac(key, first))
    second = _receive(source, key, first)
    third = secrets.token_bytes(NONCE)
    sock.sendall(third + _mac(key, first + second + third))


def connect(sock: socket.socket, source: SocketSource, key: bytes) -> None:
    """Executes the authentication for the end that opened the connection. Raises WireError if the other end
    lacks the key."""
    first = _receive(source, key, b"")
    second = secrets.token_bytes(NONCE)
    sock.sendall(second + _mac(key, first + second))
    _receive(source, key, first + second)


def _mac(key: bytes, nonces: bytes) -> bytes:
    return hmac.digest(key, nonces, "sha256")


def _receive(source: SocketSource, key: bytes, before: bytes) -> bytes:
    nonce, mac = source.take(NONCE), source.take(DIGEST)
    if not hmac.compare_digest(mac, _mac(key, before + nonce)):
        raise WireError("authentication failed: the peer's key in auth.conf is another one, or it has none")
    return nonce
