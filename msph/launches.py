"""Kernels that launch fast, and the decorators of kernels and of classes with kernels.

Taichi 1.7.4 takes 30 to 70 us of Python per launch to look up the compiled kernel, and 0.7 us per
attribute access of an object with kernels: 1 ms of a frame of 5 ms. Here the first launch goes
through Taichi; later launches reuse the compiled kernel and only set the arguments (5 us). If
PLAIN, kernels are Taichi's own: same results, slower launches.
"""

import contextlib
import functools
import itertools
import math
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
import taichi as ti

from msph.taichi_internals import (
    ARRAY_SETTER,
    EQUAL_PARTS,
    GETTERS,
    GRID,
    LOOPS,
    PLAIN,
    SETTERS,
    VECTOR_SETTERS,
    on_cpu,
    on_cuda,
)

if not PLAIN:
    from msph.taichi_internals import ASTTransformer, AutodiffMode, Kernel, impl, ndarray_type

VECTOR = type(ti.math.vec3)
# Largest number of particles with which a CPU runs the loops of a kernel, or of a heavy kernel, in
# the launching thread: waking two threads takes 40 us per loop (bench/results/speed_log.md).
MOST_SERIAL, MOST_HEAVY_SERIAL = 3000, 300
# The same for loops that only read and write a few numbers per particle, in all kernels.
MOST_LIGHT_SERIAL = 40_000
# Blocks of 128 threads in a GPU's loops: of scenes with at most FEW particles, and of others. A
# frame of `dam_break` takes 9.4 ms on an H200, with Taichi's 8,448 blocks 15.9 ms; one of 314,432
# particles takes as long with 2,112 as with 8,448 (bench/results/gpu.md).
FEW, FEW_BLOCKS, BLOCKS = 100_000, 528, 2112


class Traits:
    """What the kernels of a scene are compiled for, each case at its first launch.

    particles: estimated number, which decides if loops run in parallel or serially on a CPU, and in
    how many blocks on a GPU. Kernels read `bodies` in ti.static(), so that scenes without bodies do
    not pay for them, and `light` in ti.loop_config(serialize=...) of loops without an inner loop.
    With plain Taichi, kernels are compiled once, with bodies and parallel loops.
    """

    def __init__(self, particles: float = math.inf):
        self.case = True, False  # bodies and light
        self.particles = particles
        self.asked: set[str] = set()  # which of `bodies` and `light` were read

    @property
    def particles(self) -> float:
        """Estimated number of particles."""
        return self._particles

    @particles.setter
    def particles(self, particles: float) -> None:
        self._particles = particles
        light = particles <= MOST_LIGHT_SERIAL and on_cpu() and not PLAIN
        self.case = self.case[0], light

    @property
    def bodies(self) -> bool:
        """True if kernels handle bodies."""
        self.asked.add("bodies")
        return self.case[0]

    @bodies.setter
    def bodies(self, bodies: bool) -> None:
        self.case = bodies or PLAIN, self.case[1]

    @property
    def light(self) -> bool:
        """True if light loops are serial."""
        self.asked.add("light")
        return self.case[1]

    def like(self) -> list[tuple[bool, bool]]:
        """Returns the cases for which a kernel is the same that read the `asked` properties."""
        values = [
            (value,) if name in self.asked else (False, True)
            for name, value in zip(("bodies", "light"), self.case, strict=True)
        ]
        return list(itertools.product(*values))


# Traits of the objects that are created now, and True while all compiled loops become serial.
_traits = Traits()
_serial = False
# Elapsed time [s] spent on compiling kernels.
_compiling = 0.0
# True in run_in_steps(); kernels that it compiled, but has not launched.
_in_steps = False
_unlaunched: set[Any] = set()


@contextlib.contextmanager
def use_traits(traits: Traits):
    """Sets the Traits of all objects with kernels that are created in the block."""
    global _traits
    before, _traits = _traits, traits
    try:
        yield
    finally:
        _traits = before


def serialize_loops() -> None:
    """Makes the loops of all later kernels serial: with one thread this saves the wake-up of a
    thread, half of the frame time of 500 particles. No effect with plain Taichi."""
    global _serial
    _serial = True


def _build_loop(build: Callable, context: Any, node: Any) -> Any:
    """Calls Taichi's `build` of a loop, which becomes serial if _serial is True."""
    if _serial:
        serialize(context)
    return build(context, node)


def serialize(context: Any) -> None:
    """Makes the next loop of the kernel in compilation serial."""
    context.ast_builder.strictly_serialize()


if not PLAIN:
    for name in LOOPS:
        serial = functools.partial(_build_loop, getattr(ASTTransformer, name))
        setattr(ASTTransformer, name, staticmethod(serial))


_watchers: list[Callable[[str], None]] = []


@contextlib.contextmanager
def watch_compiling(watcher: Callable[[str], None]):
    """Calls watcher("Class.kernel") before each kernel compiled in the block; never with plain
    Taichi."""
    _watchers.append(watcher)
    try:
        yield
    finally:
        _watchers.remove(watcher)


def compile_time() -> float:
    """Returns the elapsed time [s] that this process has spent on compiling kernels; 0 with plain
    Taichi."""
    return _compiling


class NotCompiledError(Exception):
    """Ends a function that run_in_steps() calls, since a kernel had to be compiled."""


def run_in_steps(function: Callable[[], Any]) -> bool:
    """Calls a function up to the first kernel that must be compiled, compiles it, or generates its
    machine code and launches it, and returns False; returns True if the function has ended. The
    function must have the same effect if it begins again. With plain Taichi, it always ends."""
    global _in_steps
    _in_steps = True
    try:
        function()
        return True
    except NotCompiledError:
        return False
    finally:
        _in_steps = False


@contextlib.contextmanager
def watch_launches(watcher: Callable[[Any, str], None]):
    """Calls watcher(object, kernel) before each launch in the block; never with plain Taichi."""
    launch = _Launcher.__call__

    def watched(self, *args):
        watcher(self.owner, self.taichi.func.__name__.lstrip("_"))
        return launch(self, *args)

    _Launcher.__call__ = watched  # type: ignore[method-assign]
    try:
        yield
    finally:
        _Launcher.__call__ = launch  # type: ignore[method-assign]


def _taichi_kernel(function: Callable) -> "Kernel":
    """Returns Taichi's own kernel of a method."""
    return Kernel(function, autodiff_mode=AutodiffMode.NONE, _classkernel=True)


class FastKernel:
    """Kernel method, compiled once per object, traits and values of template arguments; a result
    that is a vector may be a list. heavy: its iterations take long and unequal times, so that CPU
    threads take blocks of them in turn, already in smaller scenes. small: its loops run over few
    rows, such as those of bodies, instead of particles, and are serial on a CPU."""

    def __init__(self, function: Callable, heavy: bool = False, small: bool = False):
        functools.update_wrapper(self, function)
        self.function, self.taichi, self.heavy = function, _taichi_kernel(function), heavy
        self.most = math.inf if small else MOST_HEAVY_SERIAL if heavy else MOST_SERIAL

    @functools.cached_property
    def variants(self) -> dict[tuple[bool, ...], "Kernel"]:
        """The kernel by whether all loops are serial, and by Traits.case."""
        return {(False, True, False): self.taichi}

    def variant(self, *case: bool) -> "Kernel":
        """Returns the kernel of a variant."""
        if case not in self.variants:
            self.variants[case] = _taichi_kernel(self.function)
        return self.variants[case]

    def __get__(self, owner: Any, cls: type | None = None):
        if owner is None:
            return self
        # The instance attribute replaces this descriptor in later calls.
        launcher = owner.__dict__[self.taichi.func.__name__] = _Launcher(self, owner)
        return launcher


class _Launcher:
    """Kernel bound to its object."""

    def __init__(self, fast: FastKernel, owner: Any):
        taichi = fast.taichi
        self.kernel, self.taichi, self.owner = fast, taichi, owner
        self.count, self.traits = len(taichi.arguments) - 1, owner.__dict__["traits"]
        # Most particles with which the kernel's loops are serial, or of few blocks on CUDA.
        self.most = fast.most if on_cpu() else FEW if on_cuda() else 0
        # Places of templates, numbers, vectors and arrays among the arguments, without self.
        self.templates: list[int] = []
        self.numbers: list[tuple[int, tuple[int], str]] = []
        self.vectors: list[tuple[int, list[tuple[int, int]], str]] = []
        self.arrays: list[tuple[int, tuple[int]]] = []
        self.fast = True  # False if there are arguments or results of other types
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
            elif isinstance(kind, ndarray_type.NdarrayType):
                self.arrays.append((place, (slot,)))
            else:
                self.fast = False
            slot += 1
        results = taichi.return_type or ()
        kinds = [r.dtype if isinstance(r, VECTOR) else r for r in results]
        self.fast = self.fast and len(results) <= 1 and all(kind in GETTERS for kind in kinds)
        self.getter = GETTERS[kinds[0]] if self.fast and results else None
        # Number of components of a result that is a vector, otherwise None.
        self.length = results[0].n if results and isinstance(results[0], VECTOR) else None
        # Compiled kernels by Traits.case, templates and kinds of arrays.
        self.ready: dict[tuple, tuple] = {}

    def __call__(self, *args):
        # Taichi handles other types, and reports calls with a wrong number of arguments.
        if not self.fast or len(args) != self.count:
            return self.taichi(self.owner, *args)
        # With one thread, all kernels are serial.
        few = self.traits.particles <= self.most and not _serial
        key: tuple = (few, *[args[place] for place in self.templates])
        for place, _ in self.arrays:
            array = args[place]
            if not (isinstance(array, np.ndarray) and array.flags.c_contiguous):
                return self.taichi(self.owner, *args)
            key += (array.dtype, array.ndim)
        ready, began = self.ready.get((self.traits.case, key)), 0.0
        if ready is None:
            began = perf_counter()
            ready = self._compile(few, args)
            self.ready.update({(like, key): ready for like in self.traits.like()})
            if _in_steps:
                _unlaunched.add(ready[0])
                _end_step(began)
        elif _unlaunched and ready[0] in _unlaunched:
            _unlaunched.remove(ready[0])
            began = perf_counter()
        compiled, fresh, program = ready
        context = fresh()
        for place, number_slot, setter in self.numbers:
            getattr(context, setter)(number_slot, args[place])
        for place, slots, setter in self.vectors:
            set_component = getattr(context, setter)
            for component_slot, value in zip(slots, args[place], strict=True):
                set_component(component_slot, value)
        for place, array_slot in self.arrays:
            array = args[place]
            pointer = array.__array_interface__["data"][0]
            set_array = getattr(context, ARRAY_SETTER)
            set_array(array_slot, pointer, array.nbytes, array.shape, 0)
        program.launch_kernel(compiled, context)
        if began:
            # The first launch generates the machine code.
            _end_step(began)
        if self.getter:
            program.synchronize()
            get = getattr(context, self.getter)
            return get((0,)) if self.length is None else [get((0, k)) for k in range(self.length)]
        return None

    def _compile(self, few: bool, args: tuple) -> tuple:
        """Returns the compiled kernel, its context factory and the program, for these templates and
        for a scene of few particles or another."""
        for watcher in _watchers:
            watcher(f"{type(self.owner).__name__}.{self.taichi.func.__name__.lstrip('_')}")
        global _serial
        serial = few and on_cpu()
        before, _serial = _serial, _serial or serial
        taichi = self.kernel.variant(serial, *self.traits.case)
        self.traits.asked.clear()
        try:
            key = taichi.ensure_compiled(self.owner, *args)
        finally:
            _serial = before
        found, program = taichi.compiled_kernels[key], impl.get_runtime().prog
        options = {EQUAL_PARTS: not self.kernel.heavy}
        if few and not serial:
            options[GRID] = FEW_BLOCKS
        with _compiler_options(program.config(), options) as config:
            compiled = program.compile_kernel(config, program.get_device_caps(), found)
        return compiled, found.make_launch_context, program


def _end_step(began: float) -> None:
    """Counts the time since `began` [s] as time of compiling, and ends a step."""
    global _compiling
    _compiling += perf_counter() - began
    if _in_steps:
        raise NotCompiledError


@contextlib.contextmanager
def _compiler_options(config: Any, options: dict[str, Any]):
    """Sets options of Taichi's compiler in the block: the process has one set of them, which also
    holds for Taichi's own kernels."""
    before = {name: getattr(config, name) for name in options}
    for name, value in options.items():
        setattr(config, name, value)
    try:
        yield config
    finally:
        for name, value in before.items():
            setattr(config, name, value)


def _with_traits(cls: type) -> type:
    """Lets the objects of a class keep the Traits in use at their creation."""
    begin = cls.__init__  # type: ignore[misc]

    @functools.wraps(begin)
    def begin_with_traits(self, *args, **options):
        self.traits = _traits
        begin(self, *args, **options)

    cls.__init__ = begin_with_traits  # type: ignore[misc]
    return cls


def _data_oriented(cls: type) -> type:
    """Marks a class with kernels, as ti.data_oriented does, but without its attribute hook."""
    cls._data_oriented = True  # type: ignore[attr-defined]
    return _with_traits(cls)


def _plain_data_oriented(cls: type) -> type:
    return ti.data_oriented(_with_traits(cls))


# Decorators of kernels, of heavy and small kernels, and of classes with kernels.
kernel: Any = ti.kernel if PLAIN else FastKernel
heavy_kernel: Any = ti.kernel if PLAIN else functools.partial(FastKernel, heavy=True)
small_kernel: Any = ti.kernel if PLAIN else functools.partial(FastKernel, small=True)
data_oriented: Any = _plain_data_oriented if PLAIN else _data_oriented
