"""A small OpenID Connect issuer on loopback: discovery, keys, the device flow and refresh tokens.

The keys and signatures are those of joserfc. A test approves a sign-in itself, in place of a browser.
"""

from __future__ import annotations

import http.server
import json
import secrets
import ssl
import threading
import time
import urllib.parse

from joserfc import jwk, jws


class Issuer:
    """An issuer of one realm. `claims` are those of the user who signs in, `lifetime` that of tokens in seconds.
    `certificate`: the files of a certificate and its key, for https."""

    def __init__(self, port: int, client: str = "usdlive", certificate: tuple[str, str] | None = None):
        self.port, self.client, self.lifetime, self.certificate = port, client, 300, certificate
        self.claims = {"sub": "f3a9", "email": "ann@studio.example", "email_verified": True, "groups": ["lighting"]}
        self.keys: list = []
        self.codes: dict[str, dict] = {}  # by device code
        self.refresh_tokens: set[str] = set()
        self.requests: list[str] = []
        self.answers: list[dict] = []  # errors that the next polls get
        self.rotate("RSA")
        self.server: http.server.ThreadingHTTPServer | None = None

    @property
    def url(self) -> str:
        return f"{'https' if self.certificate else 'http'}://127.0.0.1:{self.port}/realms/film"

    def start(self) -> "Issuer":
        issuer = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                issuer.requests.append(self.path)
                self.answer(*issuer.get(self.path))

            def do_POST(self):
                issuer.requests.append(self.path)
                form = dict(urllib.parse.parse_qsl(self.rfile.read(int(self.headers["Content-Length"])).decode()))
                self.answer(*issuer.post(self.path, form))

            def answer(self, status: int, body: dict):
                text = json.dumps(body).encode()
                self.send_response(status)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(text)))
                self.end_headers()
                self.wfile.write(text)

            def log_message(self, *_):
                pass

        http.server.ThreadingHTTPServer.allow_reuse_address = True
        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", self.port), Handler)
        if self.certificate:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(*self.certificate)
            self.server.socket = context.wrap_socket(self.server.socket, server_side=True)
        threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True).start()
        return self

    def stop(self) -> None:
        if self.server:
            self.server.shutdown()
            self.server.server_close()
            self.server = None

    # --- keys and tokens

    def rotate(self, kind: str = "EC") -> None:
        """Signs with a new key from now on; the one before is still published."""
        options = {"kid": secrets.token_hex(4), "use": "sig"}
        key = {"RSA": lambda: jwk.RSAKey.generate_key(2048, options),
               "EC": lambda: jwk.ECKey.generate_key("P-256", options),
               "OKP": lambda: jwk.OKPKey.generate_key("Ed25519", options)}[kind]()
        self.keys = [key, *self.keys[:1]]

    def published(self) -> dict:
        return {"keys": [key.as_dict(private=False) for key in self.keys]}

    def token(self, **changed) -> str:
        """Returns a token with these claims changed; None removes one."""
        now = int(time.time())
        claims = {"iss": self.url, "aud": self.client, "iat": now, "exp": now + self.lifetime, **self.claims, **changed}
        claims = {name: value for name, value in claims.items() if value is not None}
        key = self.keys[0]
        algorithm = {"RSA": "RS256", "EC": "ES256", "OKP": "EdDSA"}[key.key_type]
        header = {"alg": algorithm, "kid": key.kid, "typ": "JWT"}
        return jws.serialize_compact(header, json.dumps(claims), key, algorithms=[algorithm])

    # --- routes

    def get(self, path: str) -> tuple[int, dict]:
        if path == "/realms/film/.well-known/openid-configuration":
            return 200, {"issuer": self.url, "jwks_uri": f"{self.url}/keys", "token_endpoint": f"{self.url}/token",
                         "device_authorization_endpoint": f"{self.url}/device",
                         "scopes_supported": ["openid", "email", "profile"]}
        if path == "/realms/film/keys":
            return 200, self.published()
        return 404, {"error": "not_found"}

    def post(self, path: str, form: dict) -> tuple[int, dict]:
        if form.get("client_id") != self.client:
            return 401, {"error": "invalid_client"}
        if path == "/realms/film/device":
            code = secrets.token_urlsafe(16)
            self.codes[code] = {"scope": form.get("scope"), "approved": False}
            return 200, {"device_code": code, "user_code": "WDJB-MJHT", "verification_uri": f"{self.url}/enter",
                         "verification_uri_complete": f"{self.url}/enter?code=WDJB-MJHT", "expires_in": 60,
                         "interval": 1}
        if path != "/realms/film/token":
            return 404, {"error": "not_found"}
        if form.get("grant_type") == "refresh_token":
            if form.get("refresh_token") not in self.refresh_tokens:
                return 400, {"error": "invalid_grant", "error_description": "the session has ended"}
            self.refresh_tokens.discard(form["refresh_token"])  # each counts once
            return 200, self.tokens()
        if self.answers:
            return 400, self.answers.pop(0)
        code = self.codes.get(form.get("device_code", ""))
        if form.get("grant_type") != "urn:ietf:params:oauth:grant-type:device_code" or code is None:
            return 400, {"error": "invalid_grant"}
        if not code["approved"]:
            return 400, {"error": "authorization_pending"}
        return 200, self.tokens()

    def tokens(self) -> dict:
        refresh = secrets.token_urlsafe(24)
        self.refresh_tokens.add(refresh)
        return {"access_token": secrets.token_urlsafe(24), "token_type": "Bearer", "expires_in": self.lifetime,
                "id_token": self.token(), "refresh_token": refresh}

    def approve(self) -> None:
        for code in self.codes.values():
            code["approved"] = True
