# SPDX-License-Identifier: Apache-2.0
"""The page behind nginx, below a path: as docs/reverse-proxy.md has it, and without its lines, one by one."""

import os
import re
import shutil
import socket
import subprocess
import time
from pathlib import Path
from typing import Any, Iterator

import pytest
from served import TOKEN, Served
from shown_page import Visit, fill

from merlin_test import LONG
from merlin_test.ports import free_ports

pytestmark = pytest.mark.processes

DOCUMENT = Path(__file__).resolve().parents[4] / "docs" / "reverse-proxy.md"
NGINX = shutil.which("nginx", path=f"{os.environ['PATH']}:/usr/sbin")  # not on the path of every user
CONFIGURATION = """
daemon off; master_process off; pid {folder}/pid; error_log {folder}/error.log;
events {{}}
http {{
  access_log off;
  client_body_temp_path {folder}/body; proxy_temp_path {folder}/proxy; fastcgi_temp_path {folder}/fastcgi;
  uwsgi_temp_path {folder}/uwsgi; scgi_temp_path {folder}/scgi;
  {server}
}}
"""
#: Lines of the documented location that are left out or changed, by the path that the changed one has here.
FORGOTTEN = {
    "host": (r"\$http_host", "$host"),
    "default": (r"proxy_set_header Host .*\n", "\n"),
    "socket": (r"proxy_set_header Upgrade .*\n", "\n"),
}


class Proxy:
    """nginx over two monitors: below paths that end with _allowed one that allows names, else another one."""

    def __init__(self, folder: Path, plain: Served, allowing: Served, port: int) -> None:
        assert NGINX is not None
        self.port = port
        (server,) = re.findall(r"```nginx\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)
        (location,) = re.findall(r"    location /merlin/ \{.*?\n    \}\n", server, re.DOTALL)
        locations = {"merlin": location}
        for path, (line, instead) in FORGOTTEN.items():
            changed = re.sub(line, instead, location)
            assert changed != location
            locations[path] = changed.replace("/merlin/", f"/{path}/")
        for path, text in list(locations.items()):
            locations[f"{path}_allowed"] = text.replace(f"/{path}/", f"/{path}_allowed/")
        nobody = location.replace("127.0.0.1:8080", f"127.0.0.1:{free_ports(1)[0]}")
        for path, text in locations.items():
            monitor = allowing if path.endswith("_allowed") else plain
            locations[path] = text.replace("127.0.0.1:8080", f"127.0.0.1:{monitor.server.port}")
        locations["nobody"] = nobody.replace("/merlin/", "/nobody/")
        server = server.replace(location, "".join(locations.values())).replace("80;", f"127.0.0.1:{port};", 1)
        file = folder / "nginx.conf"
        file.write_text(CONFIGURATION.format(folder=folder, server=server), encoding="utf-8")
        self._process = subprocess.Popen([NGINX, "-p", str(folder), "-c", str(file)])
        end = time.monotonic() + LONG
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), timeout=LONG).close()
                break
            except OSError:
                assert self._process.poll() is None and time.monotonic() < end, "nginx does not serve"
                time.sleep(0.02)

    def address(self, path: str, host: str = "localhost") -> str:
        return f"http://{host}:{self.port}/{path}/"

    def stop(self) -> None:
        self._process.kill()
        self._process.wait(LONG)


@pytest.fixture
def proxy(tmp_path: Path, open_stop: Served) -> Iterator[Proxy]:
    if NGINX is None:
        pytest.skip("nginx is missing: apt-get install nginx-light")
    (port,) = free_ports(1)
    for folder in ("allowing", "nginx"):
        (tmp_path / folder).mkdir()
    shown = [f"{host}:{port}" for host in ("localhost", "robot.localhost")]
    allowing = Served(tmp_path / "allowing", TOKEN, names=shown)
    for served in (open_stop, allowing):
        fill(served)
    open_stop.state.tree.set("meta", "open_stop", True)
    made = Proxy(tmp_path / "nginx", open_stop, allowing, port)
    yield made
    made.stop()
    allowing.stop()


class Refused(Visit):
    """A page without a connection: it shows no panel."""

    def wait(self, expression: str, argument: Any = None, limit: float = LONG) -> None:
        if "dataset.panels" not in expression:
            super().wait(expression, argument, limit)


def test_the_page_behind_nginx_below_a_path(proxy: Proxy, browser: Any, open_stop: Served) -> None:
    visit = Visit(browser, f"{proxy.address('merlin')[:-1]}?lang=de")  # nginx adds the slash that it lacks
    visit.wait_text("#connection[data-state=live]", "")
    visit.wait_text("#machines h2", "Automaten")
    for picture in ("#said-picture", "header img"):
        visit.wait("(name) => document.querySelector(name).naturalWidth > 0", picture)
    visit.wait(
        "() => document.querySelector('#map-picture image').getAttribute('href').startsWith('map.png')"
    )
    assert visit.page.evaluate("getComputedStyle(document.body).marginTop") == "0px", "its style is there"
    # What it asks for: events, the past, controls, and changes as they come.
    visit.page.click("#stop")
    visit.wait_text("#control-said:not([data-bad])", "stopped until")
    assert open_stop.robot.calls[0][0] == "stop"
    visit.page.click("#operator")
    visit.page.fill("#token", TOKEN)
    visit.page.keyboard.press("Enter")
    visit.wait_text("#operator", "Ana")
    visit.page.keyboard.press(",")
    visit.page.locator("#past-banner").wait_for()
    visit.page.keyboard.press("l")
    open_stop.state.tree.set("now", "said", {"doing": "dancing in the dark"})
    visit.wait_text("#now-doing", "ancing in the dark")
    export = visit.page.evaluate(
        "async () => (await fetch(document.querySelector('#history-note a').href)).status"
    )
    assert export == 200
    assert visit.complaints == []
    # Another robot of the same host: the token is not told to it.
    reported = []
    visit.page.on("request", lambda request: reported.append(request.headers.get("x-merlin-token")))
    visit.page.goto(proxy.address("merlin_allowed"))
    visit.wait_text("#operator", "Sign in")
    assert not any(reported)
    visit.close()


def test_what_the_proxy_forgets_is_said_on_the_page(proxy: Proxy, browser: Any) -> None:
    for path, said in (
        ("host", f"start it with allowed_hosts:=localhost:{proxy.port}."),
        ("default", f"start it with allowed_hosts:=localhost:{proxy.port}."),
        ("socket", "WebSockets are not let through: a proxy"),
    ):
        visit = Refused(browser, proxy.address(path))
        visit.wait_text("#refused", said)
        assert visit.text("#connection") == "no connection"
        visit.close()
    # A name that is not this machine's is refused as a whole; with both names allowed all is well.
    page = browser.new_page()
    page.goto(proxy.address("merlin", "robot.localhost"))
    assert "start it with allowed_hosts:=robot.localhost" in page.inner_text("body")
    page.close()
    for path in ("merlin_allowed", "host_allowed", "default_allowed"):
        visit = Visit(browser, proxy.address(path, "robot.localhost"))
        visit.wait_text("#connection", "live")
        assert not visit.page.is_visible("#refused") and visit.complaints == []
        visit.close()


def test_a_monitor_that_ends_behind_the_proxy_is_said_to_be_missing(
    proxy: Proxy, browser: Any, open_stop: Served
) -> None:
    visit = Visit(browser, proxy.address("merlin"))
    visit.wait_text("#connection", "live")
    open_stop.server.stop()
    visit.wait_text("#refused", f"localhost:{proxy.port} answers 502 Bad Gateway")
    visit.wait_text("#connection", "no news since")
    visit.close()
