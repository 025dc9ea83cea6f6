"""Open the page of `newmark-study report` in headless Chromium and look for faults.

    python tests/verification/page.py report.html [--shots FOLDER]

Needs Chromium (or Chrome) on the path, or named by CHROMIUM.  Checks, at widths of 400,
800 and 1400 px, light and dark: no message on the console, no request but for the page,
nothing wider than the window, a text for every image, no cell of a table that another
element covers, no verdict that has to be scrolled for, no column so narrow that its words
break.  With --shots also writes screenshots and the printed page.  Exits with 1 when
something is found.
"""

import argparse
import base64
import contextlib
import json
import os
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from urllib.parse import urlsplit

WIDTHS = (400, 800, 1400)
SCHEMES = ("light", "dark")

#: Overflow of the page, and images without a text.
LOOK = """({
  width: document.documentElement.scrollWidth, inner: window.innerWidth,
  images: document.querySelectorAll('svg, img').length,
  unnamed: [...document.querySelectorAll('svg, img')].filter(
    e => !(e.getAttribute('aria-label') || e.getAttribute('alt'))).length,
  height: document.documentElement.scrollHeight})"""

#: Cells that cannot be read, as lines of text: of each kind of fault how many, and the first.
#: Of a long table the first rows and some of the others are looked at.
CELLS = """(() => {
  const faults = new Map();
  const note = (kind, cell) => {
    const known = faults.get(kind) || [0, JSON.stringify(cell.innerText.slice(0, 40))];
    faults.set(kind, [known[0] + 1, known[1]]);
  };
  const textOf = cell => {
    const text = document.createRange();
    text.selectNodeContents(cell);
    return [...text.getClientRects()];
  };
  const rows = [...document.querySelectorAll('tr')].filter(
    r => (r.rowIndex < 12 || r.rowIndex % 97 == 0) && r.checkVisibility()
      // Headings that stand before each cell of a block instead are for screen readers.
      && getComputedStyle(r.parentElement).position != 'absolute');
  for (const cell of rows.flatMap(row => [...row.cells])) {
    const style = getComputedStyle(cell);
    const inner = cell.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
    const lines = new Set(textOf(cell).map(line => Math.round(line.bottom))).size;
    if (cell.textContent.length > 8 && lines > 1 && inner < 8 * 0.5 * parseFloat(style.fontSize))
      note('column narrower than 8 characters', cell);
    if (cell.scrollWidth > cell.clientWidth + 1) note('text wider than its cell', cell);
  }
  for (const table of document.querySelectorAll('.verdicts')) {
    const around = table.closest('.scroll');
    if (around.checkVisibility() && around.scrollWidth > around.clientWidth + 1)
      note('table of verdicts wider than the page', table.rows[0].cells[0]);
  }
  // What lies on top at either end and in the middle of a text belongs to its cell.
  const height = window.innerHeight;
  for (const row of rows) {
    let box = row.getBoundingClientRect();
    if (box.top < 0 || box.bottom > height) {
      window.scrollTo({top: window.scrollY + box.top - 8, behavior: 'instant'});
    }
    const scroller = row.closest('.scroll');
    for (const end of scroller.scrollWidth > scroller.clientWidth ? [1e6, 0] : [0]) {
      scroller.scrollLeft = end;
      const around = scroller.getBoundingClientRect();
      for (const cell of row.cells) {
        for (const line of textOf(cell)) {
          const y = (line.top + line.bottom) / 2;
          if (y <= 0 || y >= height) continue;
          for (const x of [line.left + 2, (line.left + line.right) / 2, line.right - 2]) {
            if (x <= around.left || x >= around.right) continue;
            const upper = document.elementFromPoint(x, y);
            if (upper && !cell.contains(upper)) note('covered text', cell);
          }
        }
      }
    }
  }
  window.scrollTo(0, 0);
  return [...faults].map(([kind, [count, first]]) => `${count} times ${kind}, first ${first}`);
})()"""


class DevTools:
    """Chromium's DevTools protocol over a WebSocket (RFC 6455)."""

    def __init__(self, address):
        where = urlsplit(address)
        self.socket = socket.create_connection((where.hostname, where.port), timeout=300)
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(
            f"GET {where.path} HTTP/1.1\r\nHost: {where.netloc}\r\nUpgrade: websocket\r\n"
            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
            "Sec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        answer = b""
        while not answer.endswith(b"\r\n\r\n"):
            answer += self.socket.recv(1)
        self.number = 0
        self.events = []

    def call(self, method, **parameters):
        """Result of a command; events that arrive before it are kept."""
        self.number += 1
        self._send(json.dumps({"id": self.number, "method": method, "params": parameters}))
        while True:
            message = self._receive()
            if message.get("id") == self.number:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']['message']}")
                return message["result"]
            self.events.append(message)

    def wait_for(self, method):
        """Wait for an event."""
        while not any(event.get("method") == method for event in self.events):
            self.events.append(self._receive())

    def _send(self, text):
        data = text.encode()
        mask = os.urandom(4)
        masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(data))
        size = (
            bytes([0x80 | len(data)])
            if len(data) < 126
            else bytes([0x80 | 126]) + struct.pack(">H", len(data))
        )
        self.socket.sendall(b"\x81" + size + mask + masked)

    def _receive(self):
        data = b""
        while True:
            first, second = self._exactly(2)
            size = second & 0x7F
            if size >= 126:
                size = int.from_bytes(self._exactly(2 if size == 126 else 8))
            data += self._exactly(size)
            if first & 0x80:
                return json.loads(data)

    def _exactly(self, count):
        data = b""
        while len(data) < count:
            part = self.socket.recv(count - len(data))
            if not part:
                raise ConnectionError("Chromium closed the connection")
            data += part
        return data


@contextlib.contextmanager
def chromium():
    """A tab of a headless Chromium, with its page, console and network watched."""
    names = (os.environ.get("CHROMIUM", ""), "chromium", "chromium-browser", "google-chrome")
    program = next(filter(None, map(shutil.which, filter(None, names))), None)
    if program is None:
        sys.exit("no Chromium on the path; set CHROMIUM")
    with tempfile.TemporaryDirectory() as profile:
        process = subprocess.Popen(
            [program, "--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0",
             f"--user-data-dir={profile}", "about:blank"],
            stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            noted = Path(profile, "DevToolsActivePort")
            for _ in range(300):
                if noted.exists() and noted.read_text().count("\n"):
                    break
                time.sleep(0.1)
            port = noted.read_text().split()[0]
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
                tabs = [tab for tab in json.load(answer) if tab["type"] == "page"]
            browser = DevTools(tabs[0]["webSocketDebuggerUrl"])
            for domain in ("Page", "Runtime", "Log", "Network"):
                browser.call(f"{domain}.enable")
            yield browser
        finally:
            process.terminate()
            process.wait()


def value_of(browser, expression):
    """What an expression comes to on the page."""
    answer = browser.call("Runtime.evaluate", expression=expression, returnByValue=True)
    if "exceptionDetails" in answer:
        raise RuntimeError(answer["exceptionDetails"]["exception"]["description"])
    return answer["result"]["value"]


def opened(browser, page, width, scheme):
    """Open a page; what happens from then on is an event."""
    browser.events.clear()
    browser.call(
        "Emulation.setDeviceMetricsOverride",
        width=width, height=900, deviceScaleFactor=1, mobile=width < 600,
    )  # fmt: skip
    browser.call(
        "Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}]
    )
    browser.call("Page.navigate", url=page.as_uri())
    browser.wait_for("Page.loadEventFired")


def faults(browser, page, width, scheme, shots):
    """What is wrong with the page at one width in one colour scheme."""
    opened(browser, page, width, scheme)
    found, cells = value_of(browser, LOOK), value_of(browser, CELLS)
    # With everything unfolded too.
    browser.call(
        "Runtime.evaluate",
        expression="document.querySelectorAll('details').forEach(e => e.open = true)",
    )
    open_, open_cells = value_of(browser, LOOK), value_of(browser, CELLS)
    time.sleep(0.5)
    browser.call("Runtime.evaluate", expression="0")  # collects late events
    if shots:
        browser.call(
            "Runtime.evaluate",
            expression="document.querySelectorAll('details').forEach(e => e.open = false)",
        )
        clip = {"x": 0, "y": 0, "width": width, "height": min(found["height"], 12_000), "scale": 1}
        shot = browser.call("Page.captureScreenshot", clip=clip, captureBeyondViewport=True)
        (shots / f"page-{width}-{scheme}.png").write_bytes(base64.b64decode(shot["data"]))
    for event in browser.events:
        if event["method"] in ("Log.entryAdded", "Runtime.consoleAPICalled"):
            yield f"console: {json.dumps(event['params'])[:200]}"
        if event["method"] == "Runtime.exceptionThrown":
            yield f"exception: {json.dumps(event['params'])[:200]}"
        if event["method"] == "Network.requestWillBeSent":
            url = event["params"]["request"]["url"]
            if url != page.as_uri() and not url.startswith("data:"):
                yield f"request: {url}"
    for state, look, unread in (("", found, cells), (" unfolded", open_, open_cells)):
        for fault in unread:
            yield f"{fault}{state}"
        if look["width"] > look["inner"] or look["inner"] > width:
            yield f"{look['width']} px wide{state}"
        if look["unnamed"]:
            yield f"{look['unnamed']} of {look['images']} images without a text{state}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("page", type=Path)
    parser.add_argument("--shots", type=Path)
    arguments = parser.parse_args()
    page = arguments.page.resolve(strict=True)
    if arguments.shots:
        arguments.shots.mkdir(parents=True, exist_ok=True)
    with chromium() as browser:
        failed = False
        for width in WIDTHS:
            for scheme in SCHEMES:
                found = list(faults(browser, page, width, scheme, arguments.shots))
                failed |= bool(found)
                print(f"{width} px, {scheme}: {'; '.join(found) or 'ok'}")
        if arguments.shots:
            printed = browser.call("Page.printToPDF", preferCSSPageSize=True)
            (arguments.shots / "page.pdf").write_bytes(base64.b64decode(printed["data"]))
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
