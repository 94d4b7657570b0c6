"""What is wrong with a lesson, in one line."""

from msph.scene.errors import SceneError


class LessonError(SceneError):
    """A lesson that cannot be used: where, key, problem."""
