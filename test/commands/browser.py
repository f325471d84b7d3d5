"""Headless Chromium, driven by chromedriver over the WebDriver protocol.

``python3 test/commands/browser.py URL FILE [WIDTH HEIGHT [dark]]`` takes a screenshot of a ``view`` page.
"""
import base64
import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from contextlib import contextmanager
from pathlib import Path

CHROMIUM = next((path for name in ('chromium', 'chromium-browser', 'google-chrome') if (path := shutil.which(name))),
                None)
DRIVER = shutil.which('chromedriver')
ABSENT = 'no chromium with chromedriver on this machine; on Debian: apt install chromium chromium-driver'
_FLAGS = ('--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--disable-sync',
          '--disable-background-networking', '--disable-component-update', '--window-size=1400,860',
          '--use-angle=swiftshader', '--enable-unsafe-swiftshader',     # WebGL in software
          # All pages are trusted and share one process: starting a process for each page would take as long as its
          # test.
          '--renderer-process-limit=1', '--disable-site-isolation-trials', '--disable-features='
          'SpareRendererForSitePerProcess,BackForwardCache,ProactivelySwapBrowsingInstance,RenderDocument')
_LONGEST_S = 60.0
# WebDriver's key codes.
_KEYS = {'ArrowLeft': '\ue012', 'ArrowUp': '\ue013', 'ArrowRight': '\ue014', 'Home': '\ue011', 'End': '\ue010',
         'Tab': '\ue004'}


class Browser:
    """The page of a WebDriver session."""

    def __init__(self, address, profile):
        options = {'binary': CHROMIUM, 'args': [*_FLAGS, f'--user-data-dir={profile}']}
        wanted = {'browserName': 'chrome', 'goog:chromeOptions': options, 'goog:loggingPrefs': {'browser': 'ALL'}}
        self._address = f'{address}/session'
        self._address += '/' + self._call('', {'capabilities': {'alwaysMatch': wanted}})['sessionId']

    def _call(self, path, body=None, method=None):
        data = None if body is None else json.dumps(body).encode()
        kind = {'Content-Type': 'application/json'}
        request = urllib.request.Request(self._address + path, data, kind, method=method)
        with urllib.request.urlopen(request, timeout=_LONGEST_S) as answer:
            return json.load(answer)['value']

    def open(self, url):
        self._call('/url', {'url': url})

    def run(self, script):
        """Return the value that a script returns."""
        return self._call('/execute/sync', {'script': script, 'args': []})

    def wait(self, script):
        """Wait until a script returns a true value, and return this value."""
        end = time.monotonic() + _LONGEST_S
        while not (value := self.run(script)):
            assert time.monotonic() < end, f'{script} stayed {value!r}; the log: {self.log()}'
            time.sleep(0.05)
        return value

    def begin_anew(self):
        """Leave the page, and reset its storage, size, colour scheme and messages."""
        self.open('about:blank')
        self._devtools('Storage.clearDataForOrigin', origin='*', storageTypes='all')
        self._devtools('Network.clearBrowserCookies')
        self._devtools('Emulation.clearDeviceMetricsOverride')
        self._devtools('Emulation.setEmulatedMedia', features=[])
        self.log()

    def open_view(self, url):
        """Open the page of ``view`` and wait until it can be used."""
        self.open(url)
        self.wait('return document.body.dataset.ready === "yes" && !document.querySelector("progress")')

    def click(self, name):
        self.run(f'document.getElementById("{name}").click()')

    def look(self, width, height, dark=False):
        """Set the page's size in pixels (a phone's if less than 600 wide) and a light or dark colour scheme."""
        self._devtools('Emulation.setDeviceMetricsOverride', width=width, height=height, deviceScaleFactor=1,
                       mobile=width < 600)
        scheme = {'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'}
        self._devtools('Emulation.setEmulatedMedia', features=[scheme])

    def press(self, key):
        """Press and release a key, given by the name that the page receives, such as ' ' or 'Home'."""
        keys = [{'type': kind, 'value': _KEYS.get(key, key)} for kind in ('keyDown', 'keyUp')]
        self._call('/actions', {'actions': [{'type': 'key', 'id': 'keyboard', 'actions': keys}]})

    def _devtools(self, command, **parameters):
        self._call('/goog/cdp/execute', {'cmd': command, 'params': parameters})

    def violations(self, axe):
        """Run axe from the given script, and return the violated rules with their elements."""
        self.run(f'if (!window.axe) {{ {axe} }}')
        return self.run("""return axe.run({resultTypes: ['violations']}).then(({violations}) => violations.flatMap(
            ({id, nodes}) => nodes.map(({html}) => `${id}: ${html.slice(0, 200)}`)))""")

    def log(self):
        """Return the console's messages as (level, message)."""
        return [(entry['level'], entry['message']) for entry in self._call('/se/log', {'type': 'browser'})]

    def screenshot(self, path):
        path.write_bytes(base64.b64decode(self._call('/screenshot')))

    def close(self):
        self._call('', method='DELETE')


@contextmanager
def browser(folder):
    """A browser that keeps its profile and log in a folder."""
    with (folder / 'chromedriver.log').open('w+') as log:
        driver = subprocess.Popen([DRIVER, '--port=0'], stdout=log, stderr=subprocess.STDOUT)
        try:
            end = time.monotonic() + _LONGEST_S
            while not (port := re.search(r'successfully on port (\d+)', (folder / 'chromedriver.log').read_text())):
                assert time.monotonic() < end, 'chromedriver printed no port'
                time.sleep(0.05)
            page = Browser(f'http://127.0.0.1:{port[1]}', folder / 'profile')
            try:
                yield page
            finally:
                page.close()
        finally:
            driver.terminate()
            driver.wait(timeout=20)


if __name__ == '__main__':
    with tempfile.TemporaryDirectory() as scratch, browser(Path(scratch)) as shown:
        if sys.argv[3:]:
            shown.look(*map(int, sys.argv[3:5]), dark='dark' in sys.argv[5:])
        shown.open_view(sys.argv[1])
        shown.screenshot(Path(sys.argv[2]))
