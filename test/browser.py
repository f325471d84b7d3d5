"""Headless Chromium, driven through the pipe of its DevTools protocol.

``python3 test/browser.py URL FILE [WIDTH HEIGHT [dark]]`` takes a screenshot of a ``view`` page.
"""
import base64
import json
import select
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

CHROMIUM = next((path for name in ('chromium', 'chromium-browser', 'google-chrome') if (path := shutil.which(name))),
                None)
ABSENT = 'no chromium on this machine; on Debian: apt install chromium'
_FLAGS = ('--headless', '--remote-debugging-pipe', '--no-sandbox', '--disable-gpu', '--disable-quic',
          '--no-first-run', '--disable-sync',
          '--disable-background-networking', '--disable-component-update', '--window-size=1400,860',
          '--use-angle=swiftshader', '--enable-unsafe-swiftshader',     # WebGL in software
          # All pages are trusted and share one process: starting a process for each page would take as long as its
          # test.
          '--renderer-process-limit=1', '--disable-site-isolation-trials', '--disable-features='
          'SpareRendererForSitePerProcess,BackForwardCache,ProactivelySwapBrowsingInstance,RenderDocument')
_LONGEST_S = 60.0
# Windows' key codes, by which Chromium recognises keys that type nothing.
_KEYS = {'ArrowLeft': 37, 'ArrowUp': 38, 'ArrowRight': 39, 'Home': 36, 'End': 35, 'Tab': 9}


class Browser:
    """The page of a browser whose standard input and output are the pipe of its DevTools protocol."""

    def __init__(self, process):
        self._process, self._read, self._sent = process, b'', 0
        self._session, self._said, self._loaded = None, [], False
        (page,) = (one for one in self._devtools('Target.getTargets')['targetInfos'] if one['type'] == 'page')
        self._session = self._devtools('Target.attachToTarget', targetId=page['targetId'], flatten=True)['sessionId']
        for domain in ('Page', 'Runtime', 'Log'):
            self._devtools(f'{domain}.enable')
        self._devtools('Emulation.setFocusEmulationEnabled', enabled=True)

    def _devtools(self, command, **parameters):
        """Return the result of a command."""
        self._sent += 1
        message = {'id': self._sent, 'method': command, 'params': parameters}
        if self._session:
            message['sessionId'] = self._session
        self._process.stdin.write(json.dumps(message).encode() + b'\0')
        self._process.stdin.flush()
        while (answer := self._next()).get('id') != self._sent:
            pass
        assert 'error' not in answer, f'{command}: {answer}'
        return answer['result']

    def _next(self):
        """Wait for the next message, and keep what it says about the page."""
        while b'\0' not in self._read:
            assert select.select([self._process.stdout], [], [], _LONGEST_S)[0], 'the browser does not answer'
            new = self._process.stdout.read1(1 << 20)
            assert new, 'the browser has ended'
            self._read += new
        line, _, self._read = self._read.partition(b'\0')
        message = json.loads(line)
        said, name = message.get('params', {}), message.get('method')
        if name == 'Page.loadEventFired':
            self._loaded = True
        elif name == 'Log.entryAdded':
            self._said.append((said['entry']['level'], f"{said['entry'].get('url', '')} {said['entry']['text']}"))
        elif name == 'Runtime.consoleAPICalled':
            self._said.append((said['type'], ' '.join(str(one.get('value', one)) for one in said['args'])))
        elif name == 'Runtime.exceptionThrown':
            self._said.append(('error', json.dumps(said['exceptionDetails'])))
        return message

    def open(self, url):
        """Open an address, and wait until it is loaded."""
        self._loaded = False
        if 'loaderId' in self._devtools('Page.navigate', url=url):      # otherwise, only the fragment has changed
            while not self._loaded:
                self._next()

    def run(self, script):
        """Return the value that a script returns or promises."""
        result = self._devtools('Runtime.evaluate', expression=f'(() => {{ {script}\n}})()', awaitPromise=True,
                                returnByValue=True, userGesture=True)
        assert 'exceptionDetails' not in result, result
        return result['result'].get('value')

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
        code = _KEYS.get(key)
        typed = {'windowsVirtualKeyCode': code} if code else {'text': key}
        for kind in ('keyDown', 'keyUp'):
            self._devtools('Input.dispatchKeyEvent', type=kind, key=key, code=key, **typed)
            typed.pop('text', None)

    def violations(self, axe):
        """Run axe from the given script, and return the violated rules with their elements."""
        self.run(f'if (!window.axe) {{ {axe} }}')
        return self.run("""return axe.run({resultTypes: ['violations']}).then(({violations}) => violations.flatMap(
            ({id, nodes}) => nodes.map(({html}) => `${id}: ${html.slice(0, 200)}`)))""")

    def log(self):
        """Return the console's new messages as (level, message)."""
        self.run('')        # messages of the page come before its answer
        said, self._said = self._said, []
        return said

    def screenshot(self, path):
        path.write_bytes(base64.b64decode(self._devtools('Page.captureScreenshot')['data']))


@contextmanager
def browser(folder):
    """A browser that keeps its profile and log in a folder."""
    command = ['sh', '-c', 'exec "$0" "$@" 3<&0 4>&1 0</dev/null 1>&2', CHROMIUM, *_FLAGS,
               f'--user-data-dir={folder / "profile"}', 'about:blank']
    with (folder / 'chromium.log').open('wb') as log, subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log) as process:
        try:
            yield Browser(process)
        finally:
            process.terminate()
            process.wait(timeout=20)


if __name__ == '__main__':
    with tempfile.TemporaryDirectory() as scratch, browser(Path(scratch)) as shown:
        if sys.argv[3:]:
            shown.look(*map(int, sys.argv[3:5]), dark='dark' in sys.argv[5:])
        shown.open_view(sys.argv[1])
        shown.screenshot(Path(sys.argv[2]))
