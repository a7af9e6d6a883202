# SPDX-License-Identifier: Apache-2.0
"""Certificates of one side of the connection to the hub, and what is wrong with them."""

import http.client
import os
import socket
import ssl
from email.utils import parsedate_to_datetime
from typing import NamedTuple, Optional

import grpc


class HubError(Exception):
    """etcd has not answered, or refuses. A transaction may have been done all the same."""


class Tls(NamedTuple):
    """Files of certificates. A path may begin with `~`, which no shell replaces in a line of roslaunch."""

    ca: str
    certificate: str
    key: str

    def credentials(self) -> grpc.ChannelCredentials:
        """The credentials for grpc.

        :raises HubError: for files that cannot be read, or do not belong together.
        """
        self.context()
        parts = []
        for path in (self.ca, self.key, self.certificate):
            try:
                with open(os.path.expanduser(path), "rb") as file:
                    parts.append(file.read())
            except OSError as error:
                raise HubError(f"the certificate cannot be read: {error}") from None
        return grpc.ssl_channel_credentials(*parts)

    def context(self) -> ssl.SSLContext:
        """The context for Python's ssl.

        :raises HubError: for files that cannot be read, or do not belong together.
        """
        context = ssl.create_default_context(ssl.Purpose.SERVER_AUTH)
        ca, certificate, key = map(os.path.expanduser, self)
        try:
            context.load_verify_locations(ca)
            context.load_cert_chain(certificate, key, password=lambda: "")
        except OSError as error:  # those of ssl are such errors, too
            files = f"{self.ca}, {self.certificate} and {self.key}"
            raise HubError(f"the certificates {files} cannot be read or do not fit: {error}") from None
        return context


def time_of(endpoint: str, tls: Optional[Tls], timeout: float) -> float:
    """The time of a hub's clock, s since 1970, right to 1 s.

    etcd's own calls have no time; its web server, on the same port, writes one into each answer.

    :raises HubError: when there was no answer with a time.
    """
    host, _, port = endpoint.rpartition(":")
    host = host.strip("[]")
    connection = http.client.HTTPConnection(host, int(port), timeout=timeout)
    try:
        if tls is not None:
            connection = http.client.HTTPSConnection(host, int(port), timeout=timeout, context=tls.context())
        connection.request("HEAD", "/version")
        date = connection.getresponse().getheader("Date", "")
        return parsedate_to_datetime(date).timestamp() + 0.5  # the part of a second is cut off
    except (OSError, http.client.HTTPException, ValueError, TypeError) as error:
        raise HubError(f"the hub does not tell its time ({error})") from None
    finally:
        connection.close()


def certificate_problem(endpoint: str, tls: Tls, timeout: float) -> str:
    """Tries a connection: whether it fails for the certificates, and why; empty: it does not."""
    host, _, port = endpoint.rpartition(":")
    try:
        plain = socket.create_connection((host.strip("[]"), int(port)), timeout)
        with plain, tls.context().wrap_socket(plain, server_hostname=host.strip("[]")) as stream:
            # The hub looks at the client's certificate only after this side has ended its handshake.
            stream.sendall(b"GET /version HTTP/1.0\r\n\r\n")
            stream.recv(1)
    except ssl.SSLCertVerificationError as error:
        return f"the hub's certificate is not one for {host} that {tls.ca} has signed: {error.verify_message}"
    except ssl.SSLError as error:
        why = f"another authority has signed it, or its time is over ({error.reason})"
        return f"the hub does not take the certificate {tls.certificate}: {why}"
    except (OSError, ValueError):
        pass
    return ""
