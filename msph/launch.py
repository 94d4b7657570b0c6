"""Kernels that start fast.

Taichi 1.7.4 takes 30 to 70 us of Python per launch to find again what it compiled for these
arguments, and .7 us more for each attribute of an object that has kernels: 1 ms in a frame of
layered water, which computes for 5. Here a kernel's first launch goes through Taichi; what it found
is kept, and each later one only sets the numbers: 5 us.
"""

import functools
from collections.abc import Callable
from typing import Any

import taichi as ti
from taichi.lang import impl
from taichi.lang.enums import AutodiffMode
from taichi.lang.kernel_impl import Kernel

# By type of an argument or result: how a launch sets it, and how its result is read.
SETTERS = {ti.i32: "set_arg_int", ti.f32: "set_arg_float"}
GETTERS = {ti.i32: "get_struct_ret_int", ti.f32: "get_struct_ret_float"}


def data_oriented(cls: type) -> type:
    """Marks a class that has kernels, as Taichi's own decorator does, which besides looks at each
    attribute that is read."""
    cls._data_oriented = True  # type: ignore[attr-defined]
    return cls


class kernel:  # noqa: N801 - stands where ti.kernel would
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

    def __init__(self, taichi: Kernel, owner: Any):
        self.taichi, self.owner, self.count = taichi, owner, len(taichi.arguments) - 1
        # Templates and numbers among the arguments, the object itself left out.
        self.templates: list[int] = []
        self.numbers: list[tuple[int, tuple[int], str]] = []
        self.plain = True  # whether there is nothing else
        for place, argument in enumerate(taichi.arguments[1:]):
            if isinstance(argument.annotation, ti.template):
                self.templates.append(place)
            elif argument.annotation in SETTERS:
                slot = (len(self.numbers),)
                self.numbers.append((place, slot, SETTERS[argument.annotation]))
            else:
                self.plain = False
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
        for place, slot, setter in self.numbers:
            getattr(context, setter)(slot, args[place])
        program.launch_kernel(compiled, context)
        if self.getter:
            program.synchronize()
            return getattr(context, self.getter)((0,))
        return None

    def _compile(self, args: tuple) -> tuple:
        """What a launch needs, for the templates among the arguments."""
        key = self.taichi.ensure_compiled(self.owner, *args)
        found, program = self.taichi.compiled_kernels[key], impl.get_runtime().prog
        compiled = program.compile_kernel(program.config(), program.get_device_caps(), found)
        return compiled, found.make_launch_context, program
