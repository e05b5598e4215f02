"""The live side of a 3D view: a small web server in this process, on the loopback interface only.

meshcat's own server runs in a second process, listens on every interface and prints its address, and its page
looks for a web socket at the root of the host, which no proxy serves. This one listens on 127.0.0.1, says
nothing, and its page uses relative addresses only, so Jupyter's proxy can carry it to a browser elsewhere.
A token in the path keeps other users of the same machine out.
"""

from __future__ import annotations

import asyncio
import os
import secrets
import socket
import threading
from collections.abc import Callable
from typing import Any

from tornado import httpserver, netutil, web, websocket

from gvp_lib.errors import GvpError
from gvp_lib.views.page import meshcat_script, to_text

SCRIPT = "meshcat.min.js"
"""Address of meshcat's script, relative to the page of a live view."""


class Channel:
    """One live view: the page it serves, the commands that build its scene, and the browsers that look at it."""

    def __init__(self, page: Callable[[], str], commands: Callable[[], list[dict[str, Any]]]) -> None:
        self.page, self.commands = page, commands
        self.listeners: set[_Socket] = set()

    def send(self, commands: list[dict[str, Any]]) -> None:
        """Pass commands to every browser that looks on, from any thread."""
        if self.listeners:
            LiveServer.shared().loop.call_soon_threadsafe(self._write, to_text(commands))

    def _write(self, text: str) -> None:
        for listener in tuple(self.listeners):
            try:
                listener.write_message(text)
            except websocket.WebSocketClosedError:
                self.listeners.discard(listener)


class LiveServer:
    """The process's one web server; :meth:`shared` starts it when the first view needs it.

    Raises
    ------
    GvpError
        This machine lets no program listen on its loopback interface.
    """

    _instance: LiveServer | None = None

    def __init__(self) -> None:
        self.token = secrets.token_urlsafe(12)
        self.channels: dict[str, Channel] = {}
        self.loop = asyncio.new_event_loop()
        self._pid = os.getpid()
        try:  # here and not on the thread, whose errors nobody would hear of
            sockets = netutil.bind_sockets(0, address="127.0.0.1")
        except OSError as error:
            self.loop.close()
            raise GvpError(
                f"3D views are served on 127.0.0.1, where no port can be opened here ({error}). Allow this process to "
                "listen on the loopback interface (`ip link set lo up` in a bare container), or take pictures that "
                "need no server: Scene3D.still(), WorkCell.overview()"
            ) from error
        self.port = sockets[0].getsockname()[1]
        threading.Thread(target=self._run, args=(sockets,), name="gvp-views", daemon=True).start()

    @classmethod
    def shared(cls) -> LiveServer:
        """The running server. A forked worker gets its own: threads do not survive a fork."""
        if cls._instance is None or cls._instance._pid != os.getpid():
            cls._instance = cls()
        return cls._instance

    def add(self, name: str, channel: Channel) -> str:
        """Serve a channel until it is taken out of ``channels``; its page's path on the server."""
        self.channels[name] = channel
        return f"{self.token}/{name}/"

    def _run(self, sockets: list[socket.socket]) -> None:
        asyncio.set_event_loop(self.loop)
        root = rf"/{self.token}/([\w.-]+)/"
        application = web.Application(
            [(root, _Page), (f"{root}{SCRIPT}", _Script), (f"{root}socket", _Socket)],
            channels=self.channels,
            log_function=lambda handler: None,  # tornado would report every request on the notebook's stderr
            websocket_ping_interval=30,
        )
        httpserver.HTTPServer(application).add_sockets(sockets)
        self.loop.run_forever()


class _Page(web.RequestHandler):
    def get(self, name: str) -> None:
        channel = self.settings["channels"].get(name)
        if channel is None:
            raise web.HTTPError(404)
        self.set_header("Cache-Control", "no-store")
        self.write(channel.page())


class _Script(web.RequestHandler):
    def get(self, name: str) -> None:
        self.set_header("Content-Type", "text/javascript; charset=utf-8")
        self.set_header("Cache-Control", "max-age=86400")
        self.write(meshcat_script().read_bytes())


class _Socket(websocket.WebSocketHandler):
    def check_origin(self, origin: str) -> bool:
        return True  # behind a proxy the origin is the proxy's; the token in the path is what admits

    def open(self, name: str) -> None:
        self.channel: Channel | None = self.settings["channels"].get(name)
        if self.channel is None:
            self.close()
            return
        self.write_message(to_text(self.channel.commands()))
        self.channel.listeners.add(self)

    def on_message(self, message: str | bytes) -> None:
        """A view only listens."""

    def on_close(self) -> None:
        if self.channel is not None:
            self.channel.listeners.discard(self)
