"""A museum's collection as a service on loopback, for tests of the provider `omniMet`."""

import collections
import http.server
import json
import ssl
import threading
import time

BASE = "/public/collection/v1"


class Museum:
    """Departments with objects, and how the service behaves. `requests` counts the targets below the base."""

    def __init__(self, departments=3, objects=5, certificate=None):
        self.certificate = certificate  # a file with a certificate and its key, for HTTPS
        self.departments = {number: f"Department {number}" for number in range(1, departments + 1)}
        self.objects = {number: [number * 1000 + i for i in range(objects)] for number in self.departments}
        self.changed = {}  # target -> fields of the JSON that are replaced
        self.bodies = {}  # target -> the exact bytes of the answer
        self.statuses = {}  # target -> a status other than 200
        self.headers = {}  # for all answers
        self.delay = 0.0
        self.drip = {}  # target -> seconds between two bytes of the body
        self.etags = False
        self.requests = collections.Counter()
        self.unchanged = 0  # answers 304
        self.atOnce = self.most = 0
        self.connections = 0
        self._lock = threading.Lock()
        self._server = None
        self._port = 0

    def answer(self, target):
        """Returns the status and the body."""
        if target in self.bodies:
            return self.statuses.get(target, 200), self.bodies[target]
        if target in self.statuses:
            return self.statuses[target], b"{}"
        if target == "/departments":
            found = {"departments": [{"departmentId": number, "displayName": name}
                                     for number, name in self.departments.items()]}
        elif target.startswith("/objects?departmentIds="):
            ids = self.objects[int(target.partition("=")[2])]
            found = {"total": len(ids), "objectIDs": ids or None}
        elif target.startswith("/objects/"):
            number = int(target.rpartition("/")[2])
            found = {"objectID": number, "objectName": "Cup", "title": f"Cup {number}", "isHighlight": number % 2 == 0,
                     "isPublicDomain": True, "culture": "", "artistRole": "Maker", "artistDisplayName": "Ada",
                     "department": self.departments.get(number // 1000, "")}
        else:
            return 404, b"{}"
        return 200, json.dumps({**found, **self.changed.get(target, {})}).encode()

    @property
    def url(self):
        return f"{'https' if self.certificate else 'http'}://127.0.0.1:{self._port}{BASE}"

    def start(self):
        museum = self

        class Handler(http.server.BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def setup(self):
                super().setup()
                museum.connections += 1

            def do_GET(self):
                assert self.path.startswith(BASE), self.path
                target = self.path[len(BASE):]
                with museum._lock:
                    museum.requests[target] += 1
                    museum.atOnce += 1
                    museum.most = max(museum.most, museum.atOnce)
                try:
                    time.sleep(museum.delay)
                    answer = museum.answer(target)
                finally:
                    with museum._lock:  # before the answer: the client may ask again as soon as it has that
                        museum.atOnce -= 1
                try:
                    self.send(target, *answer)
                except (BrokenPipeError, ConnectionResetError):
                    self.close_connection = True

            def send(self, target, status, body):
                etag = f'"{hash(body)}"' if museum.etags else None
                if etag and self.headers.get("If-None-Match") == etag:
                    museum.unchanged += 1
                    status, body = 304, b""
                self.send_response(status)
                if etag:
                    self.send_header("ETag", etag)
                for name, value in museum.headers.items():
                    self.send_header(name, value)
                if status != 304:
                    self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                for at in range(0, len(body), 1 if target in museum.drip else max(len(body), 1)):
                    self.wfile.write(body[at:at + (1 if target in museum.drip else len(body))])
                    time.sleep(museum.drip.get(target, 0))

            def log_message(self, *_):
                pass

        class Server(http.server.ThreadingHTTPServer):
            daemon_threads = True
            request_queue_size = 64
            allow_reuse_address = True

            def handle_error(self, *_):
                pass

        self._server = Server(("127.0.0.1", self._port), Handler)
        self._port = self._server.server_address[1]
        if self.certificate:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(self.certificate)
            # The handshake is made by the thread of the connection.
            self._server.socket = context.wrap_socket(self._server.socket, server_side=True, do_handshake_on_connect=False)
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()
        return self

    def stop(self):
        """The port stays the same, and is refused until start()."""
        self._server.shutdown()
        self._server.server_close()
