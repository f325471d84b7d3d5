"""Reads scenes from a topic outside the recording thread, because reading a scene may take seconds."""
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from dragon_ros.core.errors import DragonError
from dragon_ros.core.limits import SCENE_CHARACTERS
from dragon_ros.core.scene import Scene
from dragon_ros.scenes import provenance
from dragon_ros.scenes.load import strangers_scene


class ReadScene(NamedTuple):
    """A scene text, the scene that it describes, and the metadata record for a bag.

    If the text is invalid, the scene is None, and ``why`` gives the reason. A text that exceeds the budgets has no
    metadata; a recorder stores it only as a message.
    """

    text: str
    scene: Scene | None
    why: str = ''
    metadata: dict[str, str] | None = None


class SceneReader:
    """Reads one scene at a time; of the scenes that arrive in the meantime, it reads only the newest."""

    def __init__(self, settings: dict[str, str], trust: bool = False) -> None:
        """``settings`` holds the recorder's settings, which become part of the metadata record."""
        self._settings, self._trust = settings, trust
        self._thread = ThreadPoolExecutor(1, 'scene')
        self._job: Future[ReadScene] | None = None
        self._next: str | None = None

    @property
    def busy(self) -> bool:
        """Whether a result is pending."""
        return self._job is not None

    def read(self, text: str) -> None:
        """Read a scene text as soon as the previous one has been read."""
        if self._job is None:
            self._job = self._thread.submit(self._read, text)
        else:
            self._next = text

    def take(self, wait: bool = False) -> ReadScene | None:
        """Return the newest scene unless it was already returned or, without ``wait``, if it is still being read."""
        while self._job is not None and (wait or self._job.done()):
            found, self._job = self._result(self._job), None
            if self._next is None:
                return found
            newest, self._next = self._next, None
            self.read(newest)
        return None

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(cancel_futures=True)

    def _result(self, job: 'Future[ReadScene]') -> ReadScene:
        """Return the result of reading a scene; even an unexpected error must not end the recording."""
        error = job.exception()
        return job.result() if error is None else ReadScene('', None, f'{type(error).__name__}: {error}')

    def _read(self, text: str) -> ReadScene:
        try:
            scene, why = strangers_scene('scene', text, self._trust), ''
        except DragonError as error:
            scene, why = None, str(error)
        if scene is None and len(text) > SCENE_CHARACTERS:
            return ReadScene(text, None, why)
        return ReadScene(text, scene, why, provenance.run_metadata(text, scene, self._settings))
