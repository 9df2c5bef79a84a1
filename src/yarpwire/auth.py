"""YARP's authentication: each end proves that it has the key of `auth.conf`. Nothing is encrypted.

Acceptor A and connector B, nonces of 8 bytes, HMAC-SHA256:
    A -> B   n1, mac(n1)        B -> A   n2, mac(n1 n2)        A -> B   n3, mac(n1 n2 n3)
"""

from __future__ import annotations

import hmac
import secrets
import socket

from yarpwire.errors import WireError
from yarpwire.source import SocketSource

NONCE, DIGEST = 8, 32


def accept(sock: socket.socket, source: SocketSource, key: bytes) -> None:
    """Authenticates as the acceptor. Raises WireError when the other end does not have the key."""
    first = secrets.token_bytes(NONCE)
    sock.sendall(first + _mac(key, first))
    second = _receive(source, key, first)
    third = secrets.token_bytes(NONCE)
    sock.sendall(third + _mac(key, first + second + third))


def connect(sock: socket.socket, source: SocketSource, key: bytes) -> None:
    """Authenticates as the connector. Raises WireError when the other end does not have the key."""
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
