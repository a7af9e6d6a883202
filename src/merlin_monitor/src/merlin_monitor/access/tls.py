# SPDX-License-Identifier: Apache-2.0
"""Encryption with a certificate of the user."""

import ssl
from pathlib import Path
from typing import NamedTuple, Optional


class TlsError(ValueError):
    """The files cannot be used; the text names the one and says why."""


class ServerTls(NamedTuple):
    """What the server needs; `warning` is a sentence for the log, or empty."""

    context: ssl.SSLContext
    warning: str = ""


def read_tls(certificate: Optional[Path], key: Optional[Path]) -> Optional[ServerTls]:
    """Reads a certificate (with those above it, if there are any) and its key, both in PEM.

    :return: None: neither is given, so the page is served without encryption.
    :raises TlsError: when they cannot be used.
    """
    if certificate is None and key is None:
        return None
    if certificate is None or key is None:
        missing, given = ("key", "certificate") if key is None else ("certificate", "key")
        raise TlsError(f"a {given} is given, but no {missing}; give both certificate:=… and key:=…")
    for what, path in (("certificate", certificate), ("key", key)):
        try:
            path.read_bytes()
        except OSError as error:
            raise TlsError(f"the {what} {path} cannot be read: {error.strerror}") from error
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    _check_certificate(certificate)
    try:
        context.load_cert_chain(certificate, key, password=_no_password)
    except _Encrypted as error:
        raise TlsError(
            f"the key {key} has a password; give one without: openssl pkey -in … -out …"
        ) from error
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            raise TlsError(f"the key {key} does not belong to the certificate {certificate}") from error
        raise TlsError(f"the key {key} is not a private key in PEM: {error}") from error
    mode = key.stat().st_mode
    warning = f"the key {key} is open to others; run: chmod 600 {key}" if mode & 0o077 else ""
    return ServerTls(context, warning)


class _Encrypted(Exception):
    pass


def _no_password() -> str:
    # Without this, OpenSSL would ask the terminal, and the node would hang.
    raise _Encrypted


def _check_certificate(path: Path) -> None:
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_verify_locations(path)
    except ssl.SSLError as error:
        raise TlsError(f"the certificate {path} is not a certificate in PEM: {error}") from error
