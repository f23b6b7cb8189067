"""A server that gives an agent the answers of a test, by real HTTP on the loopback."""

import http.server
import json
import threading


class AgentServer:
    """Use as a context manager; `answers` are (status, body) in turn, the last one for good.
    `requests` are (path, Authorization or "", body).
    """

    def __init__(self, *answers):
        self.answers = list(answers)
        self.requests = []
        rig = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
                rig.requests.append((self.path, self.headers.get("Authorization", ""), body))
                status, body = rig.answers.pop(0) if len(rig.answers) > 1 else rig.answers[0]
                payload = body if isinstance(body, bytes) else json.dumps(body).encode()
                self.send_response(status)
                self.send_header("Content-Length", str(len(payload)))
                self.end_headers()
                self.wfile.write(payload)

            def do_POST(self):
                self.do_GET()

            def log_message(self, *_):
                pass

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}"

    def __enter__(self):
        threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True
        ).start()
        return self

    def __exit__(self, *_):
        self._server.shutdown()
        self._server.server_close()
