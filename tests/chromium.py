"""A real browser for tests: Chromium without a screen, driven by its own debugging protocol."""

import base64
import json
import os
import re
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-port=0",
    "--no-first-run",
    "--disable-background-networking",
    "--window-size=900,640",
)
PATIENCE = 120.0
"""[s] for one answer: without a graphics card, on a machine that is busy, a picture takes long."""
_WORDS = (
    "[document.body?.innerText ?? '', ...[...document.querySelectorAll('input')].map(one => one.value)].join('\\n')"
)
"""Everything that can be read on a page, in its fields, too."""
_OPTIONS = "[...document.querySelectorAll('[role=option]')].filter(one => one.offsetParent !== null)"
"""Of the list that is open."""
_SENT = 100
"""[ms] viser's panel sends what a user does at most every 50 ms, and of what comes sooner only the last: a click too
soon after a choice would send the click alone. A busy page is late, but runs its timers in their order."""


def _field(label):
    """A script that comes to the field beside a label."""
    return f"""(() => {{
        for (const one of document.querySelectorAll('label')) {{
            if (one.innerText.trim() !== {json.dumps(label)}) continue;
            let around = one;
            for (let up = 0; up < 6 && around; up++, around = around.parentElement) {{
                const input = around.querySelector('input:not([type=checkbox])');
                if (input) return input;
            }}
        }}
        return null;
    }})()"""


def found():
    """The browser's program; None if there is none."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
    return next((path for path in map(shutil.which, names) if path), None)


def _modest():
    """What keeps a browser that root runs from giving itself precedence over everything else."""
    program = shutil.which("setpriv") if os.geteuid() == 0 else None
    return [program, "--inh-caps=-sys_nice", "--bounding-set=-sys_nice"] if program else []


class Browser:
    """One tab. Use as a context manager."""

    def __init__(self):
        from websockets.sync.client import connect

        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        command = [*_modest(), found(), *FLAGS, f"--user-data-dir={self._folder.name}", "about:blank"]
        self._process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        address = None
        for line in self._process.stderr:
            match = re.search(r"ws://[\d.]+:(\d+)/", line)
            if match:
                address = match[1]
                break
        import urllib.request

        with urllib.request.urlopen(f"http://127.0.0.1:{address}/json") as answer:
            tab = next(one for one in json.load(answer) if one["type"] == "page")
        self._socket = connect(tab["webSocketDebuggerUrl"], max_size=1 << 28)
        self._number = 0
        self.console = []
        """Errors and warnings that the page has logged, and exceptions."""
        self.requests = []
        """Addresses that it has asked for."""
        for domain in ("Runtime", "Page", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method, **parameters):
        """A command of the protocol, and its result."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=PATIENCE))
            self._note(message)
            if message.get("id") == self._number:
                assert "error" not in message, message["error"]
                return message["result"]

    def _note(self, message):
        parameters = message.get("params", {})
        if message.get("method") == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "warning"):
            words = " ".join(str(part.get("value", part.get("description"))) for part in parameters["args"])
            self.console.append((parameters["type"], words))
        elif message.get("method") == "Runtime.exceptionThrown":
            self.console.append(("error", json.dumps(parameters["exceptionDetails"])[:2000]))
        elif message.get("method") == "Log.entryAdded":
            entry = parameters["entry"]
            self.console.append((entry["level"], f"{entry['text']} {entry.get('url', '')}".strip()))
        elif message.get("method") == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])

    def go(self, url):
        """Open a page."""
        self.call("Page.navigate", url=url)

    def run(self, script):
        """What a script comes to."""
        result = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def wait(self, condition, seconds=30.0):
        """Until a script comes to something true, which is returned."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            value = self.run(condition)
            if value:
                return value
            time.sleep(0.1)
        raise AssertionError(f"not within {seconds} s: {condition}")

    def text(self):
        """All words on the page."""
        return self.run(_WORDS)

    def wait_for(self, words, seconds=30.0):
        """Until words are on the page."""
        self.wait(f"{_WORDS}.includes({json.dumps(words)})", seconds)

    def click(self, words):
        """Press the button that has just these words."""
        script = f"""(() => {{
            const found = [...document.querySelectorAll('button, label')].filter(
                one => one.innerText.trim() === {json.dumps(words)} && one.offsetParent !== null);
            if (found.length) found[0].click();
            return found.length;
        }})()"""
        assert self.run(script), f"no button {words!r}"
        self._sent()

    def wait_checked(self, words, on, seconds=30.0):
        """Until the box with this label is checked, or not: the page hears of it a moment after the server's change,
        and a click before that would only undo what it shows.
        """
        self.wait(
            f"""[...document.querySelectorAll('label')].some(one =>
            one.innerText.trim() === {json.dumps(words)} && one.control?.checked === {json.dumps(on)})""",
            seconds,
        )

    def choose(self, label, option):
        """Take an option of the list with a label."""
        self.wait(f"!({_OPTIONS}).length", PATIENCE)  # another list may still be closing
        self._focus(label)
        self.wait(f"({_OPTIONS}).length", PATIENCE)
        script = f"""(() => {{
            const found = ({_OPTIONS}).filter(one => one.innerText.trim() === {json.dumps(option)});
            if (found.length) found[0].click();
            return found.length;
        }})()"""
        assert self.run(script), f"no option {option!r} of {label!r}"
        self.wait(f"({_field(label)})?.value === {json.dumps(option)}", PATIENCE)
        self._sent()

    def type(self, label, words):
        """Write into the field with a label."""
        self._focus(label)
        self.run("document.activeElement.select()")
        self.call("Input.insertText", text=words)
        self.key("Enter")
        self._sent()

    def key(self, name):
        """Press a key."""
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=name, code=name)

    def _focus(self, label):
        script = f"(() => {{ const input = {_field(label)}; input?.focus(); input?.click(); return !!input; }})()"
        assert self.run(script), f"no field {label!r}"

    def _sent(self):
        """Wait until the page has sent what was done last."""
        self.run(f"new Promise(then => setTimeout(then, {_SENT}))")

    def screenshot(self, path):
        """Write a PNG."""
        data = self.call("Page.captureScreenshot", format="png")["data"]
        Path(path).write_bytes(base64.b64decode(data))

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._socket.close()
        self._process.terminate()
        self._process.wait(timeout=10)
        self._process.stderr.close()
        self._folder.cleanup()
