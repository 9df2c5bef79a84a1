"""Zenoh with certificates, passwords and access rights: configuration files for router, robots and users.

Every client proves its identity by a password and by a certificate (mutual TLS). `write_files` creates a
certificate authority, which signs the certificates. The router allows each client to use only the keys that
the client needs. Zenoh's manual explains the format of the files.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tci.errors import DriverError
from tci.wires.zenoh.session import LEASE

DAYS = 825
"""Lifetime [days] of certificates. Assumed: this is the longest lifetime that browsers accept."""
SEEN = ("state", "skin/*", "facts")
"""Keys of a robot that every user of this robot may read."""
ASKED = ("join", "free")
"""Keys of a robot that those who may command it may ask."""


def write_files(
    folder: Path,
    *,
    endpoint: str,
    robots: Sequence[str],
    commanders: Mapping[str, Sequence[str]],
    watchers: Mapping[str, Sequence[str]],
) -> list[Path]:
    """Writes certificates, passwords and configuration files to `folder`, which must not exist yet.

    - `endpoint`: address of the router, `tls/HOST:PORT`.
    - `robots`: names of the robots on the network.
    - `commanders`: for each user, the robots that the user may command.
    - `watchers`: for each user, the robots that the user may only watch.

    Returns the paths of `router.json5` and of one configuration file for each robot and user. To use such a
    file on another machine, copy it with `ca.pem` and the `.pem` files of that robot or user. Raises
    DriverError if an argument is invalid, if `folder` exists, or if openssl fails.
    """
    found = re.fullmatch(r"tls/\[?([^\s/\]]+)\]?:(\d+)", endpoint)
    if found is None:
        raise DriverError(f"endpoint {endpoint!r}; valid: tls/HOST:PORT, the router as all others reach it")
    names = [*robots, *commanders, *watchers]
    for name in names:
        if (
            not re.fullmatch(r"[A-Za-z0-9_-]{1,32}", name)
            or name in ("router", "ca")
            or names.count(name) > 1
        ):
            raise DriverError(
                f"name {name!r}; valid: letters, digits, _ and -, each only once, not router or ca"
            )
    for name, wanted in (*commanders.items(), *watchers.items()):
        if unknown := set(wanted) - set(robots):
            raise DriverError(f"{name} of {', '.join(sorted(unknown))}; valid: {', '.join(robots)}")
    if shutil.which("openssl") is None:
        raise DriverError(
            "openssl makes the certificates, and is not installed; on Debian: apt install openssl"
        )
    try:
        folder.mkdir(mode=0o700, parents=True)
    except FileExistsError:
        raise DriverError(f"{folder} exists already; valid: a new folder") from None
    _authority(folder)
    passwords = {name: secrets.token_urlsafe(24) for name in ("router", *names)}
    _put(folder / "users.txt", "".join(f"{name}:{word}\n" for name, word in passwords.items()))
    for name in passwords:
        _certificate(folder, name, found[1] if name == "router" else name)
    router = {
        **_common(folder, "router", passwords["router"]),
        "mode": "router",
        "listen": {"endpoints": [f"tls/{'[::]' if ':' in found[1] else '0.0.0.0'}:{found[2]}"]},
        "access_control": _access(robots, commanders, watchers),
    }
    router["transport"]["auth"]["usrpwd"]["dictionary_file"] = str(folder.absolute() / "users.txt")
    files = [_write(folder, "router", router)]
    for name in names:
        client = {
            **_common(folder, name, passwords[name]),
            "mode": "client",
            "connect": {
                "endpoints": [endpoint], "retry": {"period_init_ms": 100, "period_max_ms": 1000},
            },
        }  # fmt: skip
        files.append(_write(folder, name, client))
    return files


def _common(folder: Path, name: str, password: str) -> dict[str, Any]:
    """Returns the settings that every configuration file contains: encryption with the certificates in
    `folder`, the identity `name` with its `password`, and no announcements on the network.
    """
    at = folder.absolute()
    certificate, key = str(at / f"{name}.pem"), str(at / f"{name}-key.pem")
    return {
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "link": {
                "protocols": ["tls"],
                "tx": {"lease": LEASE},
                "tls": {
                    "root_ca_certificate": str(at / "ca.pem"),
                    "enable_mtls": True,
                    "verify_name_on_connect": True,
                    "listen_certificate": certificate, "listen_private_key": key,
                    "connect_certificate": certificate, "connect_private_key": key,
                },
            },
            "shared_memory": {"enabled": False},
            "auth": {"usrpwd": {"user": name, "password": password}},
        },
    }  # fmt: skip


def _access(
    robots: Sequence[str], commanders: Mapping[str, Sequence[str]], watchers: Mapping[str, Sequence[str]]
) -> dict[str, Any]:
    """Returns the router's access rules: each commander may command the robots in its list, and each watcher
    may only read them. The router denies all other access."""
    rules: list[dict[str, Any]] = []

    def rule(name: str, flow: str, messages: Sequence[str], keys: Sequence[str]) -> None:
        rules.append(
            {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}
        )

    for robot in robots:
        seen = [f"tci/{robot}/{key}" for key in SEEN]
        alive, orders = (f"tci/{robot}/{key}" for key in ("alive", "orders/*"))
        asked = [f"tci/{robot}/{key}" for key in ASKED]
        rule(f"{robot} shows", "ingress", ["put", "reply", "declare_queryable"], seen)
        rule(f"{robot} lives", "ingress", ["liveliness_token"], [alive])
        rule(f"{robot} listens", "ingress", ["declare_subscriber"], [orders])
        rule(f"{robot} takes", "egress", ["put"], [orders])
        rule(f"{robot} admits", "ingress", ["reply", "declare_queryable"], asked)
        rule(f"{robot} is joined", "egress", ["query"], asked)
        rule(f"{robot} is asked", "egress", ["query", "declare_subscriber"], seen)
        rule(f"see {robot}", "ingress", ["declare_subscriber", "query"], seen)
        rule(f"get {robot}", "egress", ["put", "reply", "declare_queryable"], seen)
        rule(f"find {robot}", "egress", ["liveliness_token"], [alive])
        rule(f"order {robot}", "ingress", ["put"], [orders])
        rule(f"join {robot}", "ingress", ["query"], asked)
        rule(f"sign for {robot}", "egress", ["reply", "declare_queryable"], asked)
        # without this rule, a user can't send orders
        rule(f"reach {robot}", "egress", ["declare_subscriber"], [orders])
    rule("find robots", "ingress", ["liveliness_query", "declare_liveliness_subscriber"], ["tci/*/alive"])
    policies = [
        {"subjects": [robot], "rules": [f"{robot} {does}" for does in ("shows", "lives", "listens", "takes",
                                                                       "is asked", "admits", "is joined")]}
        for robot in robots
    ]  # fmt: skip
    for does, users in (
        (("see", "get", "find", "order", "reach", "join", "sign for"), commanders),
        (("see", "get", "find"), watchers),
    ):
        for name, wanted in users.items():
            granted = [f"{word} {robot}" for robot in wanted for word in does]
            policies.append({"subjects": [name], "rules": ["find robots", *granted]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        # The certificate and the password must belong to the same user.
        "subjects": [
            {"id": name, "cert_common_names": [name], "usernames": [name]}
            for name in (*robots, *commanders, *watchers)
        ],
        "policies": policies,
    }


def _authority(folder: Path) -> None:
    _openssl(
        "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
        "-days", f"{DAYS}",
        "-subj", "/CN=TCI", "-keyout", f"{folder / 'ca-key.pem'}", "-out", f"{folder / 'ca.pem'}",
        "-addext", "basicConstraints=critical,CA:TRUE", "-addext", "keyUsage=critical,keyCertSign",
    )  # fmt: skip


def _certificate(folder: Path, name: str, host: str) -> None:
    """Creates a private key and a certificate for `name` in `folder`, valid for the host `host`."""
    kind = "IP" if re.fullmatch(r"[0-9.]+|[0-9a-fA-F:]*:[0-9a-fA-F:]*", host) else "DNS"
    request = folder / f"{name}.csr"
    extensions = folder / f"{name}.ext"
    extensions.write_text(f"subjectAltName={kind}:{host}\nextendedKeyUsage=serverAuth,clientAuth\n")
    _openssl(
        "req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-subj", f"/CN={name}",
        "-keyout", f"{folder / f'{name}-key.pem'}", "-out", f"{request}",
    )  # fmt: skip
    _openssl(
        "x509", "-req", "-in", f"{request}",
        "-CA", f"{folder / 'ca.pem'}", "-CAkey", f"{folder / 'ca-key.pem'}",
        "-days", f"{DAYS}", "-extfile", f"{extensions}", "-out", f"{folder / f'{name}.pem'}",
    )  # fmt: skip
    request.unlink()
    extensions.unlink()


def _openssl(*arguments: str) -> None:
    done = subprocess.run(["openssl", *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise DriverError(f"openssl {arguments[0]}: {done.stderr.strip().splitlines()[-1:]}")


def _write(folder: Path, name: str, config: Mapping[str, Any]) -> Path:
    path = folder / f"{name}.json5"
    _put(path, f"// Zenoh for {name}. Keep it secret: it holds a password.\n{json.dumps(config, indent=2)}\n")
    return path


def _put(path: Path, text: str) -> None:
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(text)
