"""Runs many bare WebSocket connections on one thread, so that the server is measured and not its clients."""

from __future__ import annotations

import base64
import os
import selectors
import socket
import struct
import time

import wire

STAMP = b"stamp="
STAMP_BYTES = 40  # STAMP sequence ":" nanoseconds, padded


class Connection:
    """Sends upgrade and hello; then passes every frame to `on_frame(connection, frame)`."""

    def __init__(self, crowd: Crowd, resume=None, receive_buffer=None, user="wire", token=""):
        self.crowd, self.client = crowd, wire.new_client()
        self.welcomed = self.closed = self.upgraded = False
        self.data, self.out = bytearray(), bytearray()
        self.opened_at = time.monotonic()
        self.socket = socket.socket()
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.setblocking(False)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        host, port = crowd.address
        self.socket.connect_ex((host, port))
        key = base64.b64encode(os.urandom(16)).decode()
        self.out += (f"GET /live HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\n"
                     f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
                     + (f"Authorization: Bearer {token}\r\n" if token else "")
                     + "Sec-WebSocket-Version: 13\r\n\r\n").encode()
        self.greeting = wire.hello(self.client, user=user, resume=resume)
        crowd.selector.register(self.socket, selectors.EVENT_READ | selectors.EVENT_WRITE, self)

    def send(self, message, opcode=2):
        size = len(message)
        head = bytes([0x80 | opcode])
        head += bytes([0x80 | size]) if size < 126 else struct.pack(
            ">BH" if size < 65536 else ">BQ", 0x80 | (126 if size < 65536 else 127), size)
        self.out += head + bytes(4) + message  # masked with zeros
        self.write()

    def write(self):
        try:
            while self.out:
                del self.out[:self.socket.send(self.out)]
        except BlockingIOError:
            pass
        except OSError:
            return self.close()
        self.crowd.watch(self, bool(self.out))

    def read(self):
        try:
            while part := self.socket.recv(1 << 18):
                self.data += part
            self.parse()
            return self.close()
        except BlockingIOError:
            self.parse()
        except OSError:
            self.close()

    def parse(self):
        if not self.upgraded:
            end = self.data.find(b"\r\n\r\n")
            if end < 0:
                return
            assert self.data.startswith(b"HTTP/1.1 101"), bytes(self.data[:end])
            del self.data[:end + 4]
            self.upgraded = True
            self.send(self.greeting)
        at, data = 0, self.data
        while len(data) - at >= 2:
            opcode, size, begin = data[at] & 15, data[at + 1], at + 2
            if size >= 126:
                width = 2 if size == 126 else 8
                if len(data) < begin + width:
                    break
                size = int.from_bytes(data[begin:begin + width], "big")
                begin += width
            if len(data) < begin + size:
                break
            payload = bytes(data[begin:begin + size])
            at = begin + size
            if opcode == 9:
                self.send(payload, 10)
            elif opcode in (0, 2):
                for frame in wire.split(payload):
                    if b'"welcome"' in frame:
                        self.welcomed = True
                        self.welcomed_at = time.monotonic()
                    self.crowd.on_frame(self, frame)
        del data[:at]

    def close(self):
        if not self.closed:
            self.closed = True
            self.crowd.selector.unregister(self.socket)
            self.socket.close()


class Crowd:
    def __init__(self, server, on_frame=lambda connection, frame: None):
        self.address = ("127.0.0.1", server.port)
        self.on_frame = on_frame
        self.selector = selectors.DefaultSelector()
        self.connections: list[Connection] = []

    def join(self, count=1, **options):
        added = [Connection(self, **options) for _ in range(count)]
        self.connections += added
        return added

    def watch(self, connection, writing):
        events = selectors.EVENT_READ | (selectors.EVENT_WRITE if writing else 0)
        if not connection.closed:
            self.selector.modify(connection.socket, events, connection)

    def stop_reading(self, connection):
        """Behaves like a stopped program: its socket stays open, and nobody reads."""
        self.selector.unregister(connection.socket)

    def go_on_reading(self, connection):
        self.selector.register(connection.socket, selectors.EVENT_READ, connection)

    def turn(self, seconds):
        for key, events in self.selector.select(max(0, seconds)):
            if events & selectors.EVENT_WRITE:
                key.data.write()
            if events & selectors.EVENT_READ and not key.data.closed:
                key.data.read()

    def until(self, condition, seconds):
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                return False
            self.turn(0.02)
        return True

    def close(self):
        for connection in self.connections:
            connection.close()


def stamped(sequence: int, size: int) -> str:
    text = f"stamp={sequence}:{time.monotonic_ns()}".ljust(STAMP_BYTES)
    return text + "x" * (size - STAMP_BYTES)


def read_stamp(frame: bytes):
    """Returns (sequence, seconds on its way) of a frame that carries a stamp."""
    at = frame.find(STAMP)
    if at < 0:
        return None
    sequence, sent = frame[at + len(STAMP):at + STAMP_BYTES].split(b":")
    return int(sequence), (time.monotonic_ns() - int(sent)) / 1e9


def percentile(values, share):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(len(ordered) * share))]

