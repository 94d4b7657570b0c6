"""The error of a lesson file."""

from msph.scene.errors import SceneError


class LessonError(SceneError):
    """A lesson that cannot be used; str() is one line: file, key, problem."""
