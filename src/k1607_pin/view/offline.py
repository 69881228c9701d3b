"""A meshcat window without server or browser: it remembers what is drawn and writes it as one HTML page."""

import base64
import gzip
import html
import re
from pathlib import Path
from string import Template
from typing import Any

import meshcat
import umsgpack

_VIEWER = Path(meshcat.__file__).parent / "viewer" / "dist"
_CONTROLS = Path(__file__).with_name("controls.js")
_UUID = re.compile(rb"[0-9a-f]{8}-[0-9a-f]{4}-1[0-9a-f]{3}-[0-9a-f]{4}-[0-9a-f]{12}")

# The policy makes the browser itself refuse every request. Commands are replayed in order, one by one; meshcat's own
# static page fetches each for itself, in whatever order they arrive.
_PAGE = Template("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline'; \
style-src 'unsafe-inline'; img-src data: blob:; media-src data: blob:">
<title>$title</title>
<style>html, body { margin: 0; height: 100%; } #view { width: 100%; height: 100vh; overflow: hidden; }</style>
</head>
<body>
<div id="view"></div>
<script>
$licence
$viewer
</script>
<script>
$controls
const viewer = withControls(new MeshCat.Viewer(document.getElementById("view")));
async function draw() {
  const packed = Uint8Array.from(atob("$scene"), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = await new Response(stream).arrayBuffer();
  const view = new DataView(bytes);
  for (let at = 0; at < bytes.byteLength;) {
    const end = at + 4 + view.getUint32(at);
    viewer.handle_command_bytearray(new Uint8Array(bytes.slice(at + 4, end)));
    at = end;
  }
}
const drawn = draw().catch((error) => { document.getElementById("view").textContent = error; throw error; });
</script>
</body>
</html>
""")


class Recorder:
    """What `meshcat.Visualizer(window=...)` draws in when there is no browser yet."""

    web_url = None

    def __init__(self) -> None:
        self._commands: dict[tuple[str, str, str | None], bytes] = {}

    def send(self, command: Any) -> None:
        """Remember one meshcat command; of the same kind for the same thing, the last one counts."""
        data = command.lower()
        kind, path = data["type"], data["path"]
        if kind == "delete":
            gone = [key for key in self._commands if f"{key[1]}/".startswith(f"{path}/")]
            for key in gone:
                del self._commands[key]
            return
        key = (kind, path, data.get("property"))
        self._commands.pop(key, None)  # the order of sending is the order of drawing
        self._commands[key] = umsgpack.packb(data)

    def page(self, title: str) -> str:
        """One HTML page of everything drawn: opens from a file, offline, and asks for nothing else.

        The same drawing gives the same page, byte for byte.
        """
        scene = b"".join(len(data).to_bytes(4, "big") + data for data in self._commands.values())
        packed = gzip.compress(anonymous(scene), mtime=0)
        return _PAGE.substitute(
            title=html.escape(title),
            licence=(_VIEWER / "main.min.js.LICENSE.txt").read_text(encoding="utf-8"),
            viewer=(_VIEWER / "main.min.js").read_text(encoding="utf-8"),
            controls=_CONTROLS.read_text(encoding="utf-8"),
            scene=base64.b64encode(packed).decode(),
        )


def anonymous(scene: bytes) -> bytes:
    """The scene with meshcat's identifiers counted through: they hold the time and this machine's network address."""
    known: dict[bytes, bytes] = {}
    return _UUID.sub(lambda found: known.setdefault(found[0], b"00000000-0000-1000-8000-%012x" % len(known)), scene)
