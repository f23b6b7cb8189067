"""A camera of the network: pictures as multipart JPEG over HTTP, which can be unplugged and plugged
in again.
"""

import io
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import av
import numpy as np


def jpeg_of(grey: int, width: int = 160, height: int = 120) -> bytes:
    """Return a picture of one grey value, in full range as cameras give it."""
    kept = io.BytesIO()
    with av.open(kept, "w", format="image2pipe") as container:
        stream = container.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuvj420p"
        frame = av.VideoFrame.from_ndarray(
            np.full((height, width, 3), grey, np.uint8), format="rgb24"
        )
        for packet in (*stream.encode(frame), *stream.encode()):
            container.mux(packet)
    return kept.getvalue()


class PictureServer:
    """Serves one grey value after the other, 25 pictures a second, while it is plugged in."""

    def __init__(self, port: int = 0) -> None:
        self.plugged = threading.Event()
        self.plugged.set()
        self.pictures = [jpeg_of(grey) for grey in (0, 255)]
        server = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                server.send_pictures(self.wfile)

            def log_message(self, *_arguments) -> None:
                """Log nothing."""

        self._http = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self._http.daemon_threads = True
        self.port = self._http.server_address[1]
        self._over = threading.Event()
        threading.Thread(target=self._http.serve_forever, daemon=True).start()

    @property
    def words(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    def send_pictures(self, file) -> None:
        number = 0
        while self.plugged.is_set() and not self._over.wait(0.04):
            picture = self.pictures[number // 5 % 2]
            try:
                file.write(
                    b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n%b\r\n"
                    % (len(picture), picture)
                )
            except OSError:
                return
            number += 1

    def close(self) -> None:
        self._over.set()
        self._http.shutdown()
        self._http.server_close()
