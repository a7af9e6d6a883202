# SPDX-License-Identifier: Apache-2.0
"""Encryption with a certificate of the user: https works, http is refused, and what is wrong is said."""

import asyncio
import ssl
import subprocess
from pathlib import Path
from typing import Iterator, Tuple

import aiohttp
import pytest
from served import TOKEN, Served, ask

from merlin_monitor.access.tls import TlsError, read_tls


def make(folder: Path, name: str, *more: str) -> Tuple[Path, Path]:
    certificate, key = folder / f"{name}.pem", folder / f"{name}.key"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-days", "2"]
        + ["-subj", "/CN=localhost", "-addext", "subjectAltName=IP:127.0.0.1"]
        + ["-keyout", str(key), "-out", str(certificate), *(more or ("-nodes",))],
        check=True,
        capture_output=True,
    )
    key.chmod(0o600)
    return certificate, key


@pytest.fixture
def encrypted(tmp_path: Path) -> Iterator[Tuple[Served, Path]]:
    certificate, key = make(tmp_path, "robot")
    served = Served(tmp_path, TOKEN, read_tls(certificate, key))
    yield served, certificate
    served.stop()


def test_https_is_served_and_http_refused(encrypted: Tuple[Served, Path]) -> None:
    served, certificate = encrypted
    assert served.url.startswith("https://127.0.0.1:")

    async def look() -> Tuple[int, int, str]:
        context = ssl.create_default_context(cafile=str(certificate))
        async with aiohttp.ClientSession() as session:
            async with session.get(served.url, ssl=context) as page:
                status = page.status
            async with session.post(
                served.url + "control/who",
                ssl=context,
                data="{}",
                headers={"X-Merlin-Token": "wrong, really"},
            ) as answer:
                control = answer.status
            async with session.ws_connect(served.url + "live", ssl=context) as feed:
                return status, control, (await feed.receive_json())["state"]["queue"]["waiting"]

    assert asyncio.run(look()) == (200, 403, [])
    with pytest.raises(aiohttp.ClientError):
        ask(served.url.replace("https", "http"))
    with pytest.raises(
        aiohttp.ClientConnectorCertificateError
    ):  # a client of a self-signed certificate has to trust it itself
        ask(served.url)


def test_what_cannot_be_used_is_said(tmp_path: Path) -> None:
    certificate, key = make(tmp_path, "robot")
    other, _ = make(tmp_path, "other")
    text = tmp_path / "text.pem"
    text.write_text("no certificate")
    _, locked = make(tmp_path, "locked", "-passout", "pass:secret")
    for given, words in (
        ((certificate, None), "a certificate is given, but no key"),
        ((None, key), "a key is given, but no certificate"),
        ((tmp_path / "gone.pem", key), "the certificate .*gone.pem cannot be read: No such file"),
        ((certificate, tmp_path), "the key .* cannot be read: Is a directory"),
        ((text, key), "text.pem is not a certificate in PEM"),
        ((certificate, text), "text.pem is not a private key in PEM"),
        ((other, key), "robot.key does not belong to the certificate .*other.pem"),
        ((certificate, locked), "locked.key has a password"),
    ):
        with pytest.raises(TlsError, match=words):
            read_tls(*given)
    assert read_tls(None, None) is None


def test_a_key_that_others_can_read_is_reported(tmp_path: Path) -> None:
    certificate, key = make(tmp_path, "robot")
    assert read_tls(certificate, key).warning == ""
    key.chmod(0o644)
    assert "chmod 600" in read_tls(certificate, key).warning
