"""Everything that this project takes from Taichi's private interfaces, and what stands in for it.

Taichi 1.7.4 takes 30 to 70 us of Python per launch to find again what it compiled for these
arguments, and .7 us more for each attribute of an object that has kernels: 1 ms in a frame of
layered water, which computes for 5. Here the first launch of a kernel goes through Taichi; what it
found is kept, and each later launch only sets the arguments: 5 us.

To compile a kernel Taichi reads each function's source again wherever it is called, and draws the
place of every node of its syntax tree for messages that nobody sees: more than half of the 3 s that
its Python takes for the kernels of a scene. Here sources are read once, and a place is its line.

Where Taichi lacks any of these interfaces, which is warned of, or where MSPH_PLAIN_TAICHI is set in
the environment, kernels are Taichi's own: the same results, slower launches.
"""

import contextlib
import functools
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import taichi as ti

# Environment variable that asks for plain Taichi; any text but "" and "0" does.
SWITCH = "MSPH_PLAIN_TAICHI"
# By type of an argument or result: how a launch sets it, and how its result is read.
SETTERS = {ti.i32: "set_arg_int", ti.f32: "set_arg_float"}
VECTOR = type(ti.math.vec3)
VECTOR_SETTERS = {ti.i32: "set_struct_arg_int", ti.f32: "set_struct_arg_float"}
# What Taichi calls for each loop of a kernel over numbers.
LOOPS = ("build_range_for", "build_ndrange_for", "build_grouped_ndrange_for")
GETTERS = {ti.i32: "get_struct_ret_int", ti.f32: "get_struct_ret_float"}


def missing(required: dict[str, tuple[Any, tuple[str, ...]]]) -> str | None:
    """The first interface that is not there: of owners by name, with what is required of each."""
    for name, (owner, attributes) in required.items():
        for attribute in attributes:
            if not hasattr(owner, attribute):
                return f"{name}.{attribute}"
    return None


try:
    from taichi._lib import core
    from taichi.lang import impl, kernel_impl
    from taichi.lang.ast.ast_transformer import ASTTransformer
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext
    from taichi.lang.enums import AutodiffMode
    from taichi.lang.kernel_impl import Kernel

    _lost = missing(
        {
            "impl": (impl, ("get_runtime",)),
            "AutodiffMode": (AutodiffMode, ("NONE",)),
            "Kernel": (Kernel, ("ensure_compiled",)),
            "kernel_impl": (kernel_impl, ("getsourcelines", "getsourcefile")),
            "ASTTransformerContext": (ASTTransformerContext, ("get_pos_info",)),
            "ASTTransformer": (ASTTransformer, LOOPS),
            "core": (core, ("Program", "Kernel", "KernelLaunchContext")),
        }
    ) or missing(
        {
            "Program": (
                core.Program,
                ("config", "get_device_caps", "compile_kernel", "launch_kernel", "synchronize"),
            ),
            "core.Kernel": (core.Kernel, ("make_launch_context",)),
            "KernelLaunchContext": (
                core.KernelLaunchContext,
                (*SETTERS.values(), *VECTOR_SETTERS.values(), *GETTERS.values()),
            ),
        }
    )
except ImportError as error:
    _lost = str(error)

try:
    from taichi.ui.utils import get_field_info as _field_info
except ImportError:
    _field_info = None

if _lost:
    warnings.warn(f"Taichi {ti.__version__} lacks {_lost}: launches are slower", stacklevel=1)
# Whether kernels are Taichi's own.
PLAIN = bool(_lost) or os.environ.get(SWITCH, "") not in ("", "0")


def _position(context: Any, node: Any) -> str:
    """Where a node of a kernel's syntax tree stands, for messages: file, line, function, source."""
    line, name = node.lineno + context.lineno_offset, context.func.func.__name__
    return f'File "{context.file}", line {line}, in {name}:\n{context.src[node.lineno - 1]}\n'


if not PLAIN:
    ASTTransformerContext.get_pos_info = _position
    kernel_impl.getsourcelines = functools.cache(kernel_impl.getsourcelines)
    kernel_impl.getsourcefile = functools.cache(kernel_impl.getsourcefile)


def serialize_loops() -> None:
    """Compiles every loop of later kernels for the thread that launches them: with one thread that
    saves waking it, half of the time of a frame of 500 particles. Plain Taichi wakes it."""
    if PLAIN:
        return
    for name in LOOPS:
        build = getattr(ASTTransformer, name)

        def build_serial(context: Any, node: Any, build: Callable = build) -> Any:
            context.ast_builder.strictly_serialize()
            return build(context, node)

        setattr(ASTTransformer, name, staticmethod(build_serial))


_watchers: list[Callable[[str], None]] = []


@contextlib.contextmanager
def watch_compiling(watcher: Callable[[str], None]):
    """Calls watcher("Class.kernel") before each kernel that is compiled within; plain Taichi does
    not tell."""
    _watchers.append(watcher)
    try:
        yield
    finally:
        _watchers.remove(watcher)


@contextlib.contextmanager
def watch_launches(watcher: Callable[[Any, str], None]):
    """Calls watcher(object, kernel) before each launch within; plain Taichi does not tell."""
    launch = _Launcher.__call__

    def watched(self, *args):
        watcher(self.owner, self.taichi.func.__name__.lstrip("_"))
        return launch(self, *args)

    _Launcher.__call__ = watched  # type: ignore[method-assign]
    try:
        yield
    finally:
        _Launcher.__call__ = launch  # type: ignore[method-assign]


def on_cpu() -> bool:
    """Whether kernels run on the CPU; ti.init must have been called."""
    return ti.cfg.arch in (ti.x64, ti.arm64)


def longest_float():
    """The type of numbers in which kernels may sum: f64 on CPUs and CUDA, else f32; ti.init must
    have been called."""
    return ti.f64 if on_cpu() or ti.cfg.arch == ti.cuda else ti.f32


def cache_folder() -> Path | None:
    """Where Taichi keeps compiled kernels; None where it does not tell. Before ti.init."""
    given = os.environ.get("TI_OFFLINE_CACHE_FILE_PATH")
    config = getattr(getattr(ti._lib, "core", None), "default_compile_config", None)
    found = given or getattr(config() if config else None, "offline_cache_file_path", "")
    return Path(found) if found else None


def field_trees() -> int:
    """Trees of fields that this process has allocated; 0 where Taichi does not tell."""
    program = getattr(getattr(ti.lang.impl, "get_runtime", lambda: None)(), "prog", None)
    return program.get_snode_tree_size() if hasattr(program, "get_snode_tree_size") else 0


def set_image(canvas: Any, words: Any) -> None:
    """Puts packed pixels, (width, height) int32 with red in the lowest byte, on a canvas of GGUI,
    which else makes such words itself, one pixel after the other: 30 ms for 960x540."""
    inner = getattr(canvas, "canvas", None)
    if _field_info and not PLAIN and hasattr(inner, "set_image"):
        inner.set_image(_field_info(words.view("u4")))
    else:
        canvas.set_image(words.view("u1").reshape(*words.shape, 4))


class FastKernel:
    """A method that Taichi compiles, once per object and per value of its templates."""

    def __init__(self, function: Callable):
        functools.update_wrapper(self, function)
        self.taichi = Kernel(function, autodiff_mode=AutodiffMode.NONE, _classkernel=True)

    def __get__(self, owner: Any, cls: type | None = None):
        if owner is None:
            return self
        # From now on the object has the launcher as its own attribute.
        launcher = owner.__dict__[self.taichi.func.__name__] = _Launcher(self.taichi, owner)
        return launcher


class _Launcher:
    """A kernel bound to its object."""

    def __init__(self, taichi: "Kernel", owner: Any):
        self.taichi, self.owner, self.count = taichi, owner, len(taichi.arguments) - 1
        # Templates, numbers and vectors among the arguments, the object itself left out.
        self.templates: list[int] = []
        self.numbers: list[tuple[int, tuple[int], str]] = []
        self.vectors: list[tuple[int, list[tuple[int, int]], str]] = []
        self.plain = True  # whether there is nothing else
        slot = 0
        for place, argument in enumerate(taichi.arguments[1:]):
            kind = argument.annotation
            if isinstance(kind, ti.template):
                self.templates.append(place)
                continue
            if kind in SETTERS:
                self.numbers.append((place, (slot,), SETTERS[kind]))
            elif isinstance(kind, VECTOR) and kind.dtype in VECTOR_SETTERS:
                slots = [(slot, k) for k in range(kind.n)]
                self.vectors.append((place, slots, VECTOR_SETTERS[kind.dtype]))
            else:
                self.plain = False
            slot += 1
        results = taichi.return_type or ()
        self.plain = self.plain and len(results) <= 1 and all(r in GETTERS for r in results)
        self.getter = GETTERS[results[0]] if self.plain and results else None
        self.ready: dict[tuple, tuple] = {}

    def __call__(self, *args):
        # Taichi also says what is wrong with a call.
        if not self.plain or len(args) != self.count:
            return self.taichi(self.owner, *args)
        key = tuple([args[place] for place in self.templates])
        if key not in self.ready:
            self.ready[key] = self._compile(args)
        compiled, fresh, program = self.ready[key]
        context = fresh()
        for place, number_slot, setter in self.numbers:
            getattr(context, setter)(number_slot, args[place])
        for place, slots, setter in self.vectors:
            set_component = getattr(context, setter)
            for component_slot, value in zip(slots, args[place], strict=True):
                set_component(component_slot, value)
        program.launch_kernel(compiled, context)
        if self.getter:
            program.synchronize()
            return getattr(context, self.getter)((0,))
        return None

    def _compile(self, args: tuple) -> tuple:
        """What a launch needs, for the templates among the arguments."""
        for watcher in _watchers:
            watcher(f"{type(self.owner).__name__}.{self.taichi.func.__name__.lstrip('_')}")
        key = self.taichi.ensure_compiled(self.owner, *args)
        found, program = self.taichi.compiled_kernels[key], impl.get_runtime().prog
        compiled = program.compile_kernel(program.config(), program.get_device_caps(), found)
        return compiled, found.make_launch_context, program


def _mark(cls: type) -> type:
    """Marks a class that has kernels, as Taichi's own decorator does, which besides looks at each
    attribute that is read."""
    cls._data_oriented = True  # type: ignore[attr-defined]
    return cls


# What the project decorates its kernels and the classes that have them with.
kernel: Any = ti.kernel if PLAIN else FastKernel
data_oriented: Any = ti.data_oriented if PLAIN else _mark
