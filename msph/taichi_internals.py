"""Taichi's private interfaces: which of them exist, and what they give; fast compilation.

Compilation: Taichi reads and parses the source of a function at each of its calls, and formats the
position of every syntax node and the stack of every declaration of a field for error messages: more
than half of the 3 s of Python time for the kernels of a scene. Here sources and syntax trees are
kept, and a position is the line of a statement.

If Taichi lacks one of these interfaces (a warning says so), or if the environment variable
MSPH_PLAIN_TAICHI is set, the program does without them: same results, slower compilation and slower
launches (msph/launches.py).
"""

import ast
import contextlib
import functools
import linecache
import math
import operator
import os
import sys
import textwrap
import warnings
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import taichi as ti

from msph.cache_folder import TAICHI_FOLDER

# Environment variable that selects plain Taichi, unless it is "" or "0".
SWITCH = "MSPH_PLAIN_TAICHI"
# Methods of a launch context that set an argument or read a result, by type.
SETTERS = {ti.i32: "set_arg_int", ti.f32: "set_arg_float"}
VECTOR_SETTERS = {ti.i32: "set_struct_arg_int", ti.f32: "set_struct_arg_float"}
GETTERS = {ti.i32: "get_struct_ret_int", ti.f32: "get_struct_ret_float"}
ARRAY_SETTER = "set_arg_external_array_with_shape"
# Methods by which Taichi builds the range loops of a kernel, and methods of a program.
LOOPS = ("build_range_for", "build_ndrange_for", "build_grouped_ndrange_for")
PROGRAM = ("config", "get_device_caps", "compile_kernel", "launch_kernel", "synchronize")
# Files of Taichi's kernel cache, and errors of Taichi for damaged ones (std::length_error and
# std::bad_alloc, as it allocates the sizes that they hold).
CACHE_FILES = ("*.tic", "*.tcb")
CACHE_ERRORS = (ValueError, MemoryError)
# Folder of Taichi's Python code.
TAICHI = os.path.dirname(ti.__file__)
# Option of Taichi's compiler: a CPU loop is cut into one equal part per thread, of at least 512
# iterations, which LLVM can vectorize; without the option, threads take blocks of iterations in
# turn. Taichi's cache of kernels on disk does not distinguish its values.
EQUAL_PARTS = "make_cpu_multithreading_loop"
# Option of Taichi's compiler: number of blocks of threads in a loop on a GPU. Every thread of them
# adds to each sum of the loop, whatever the number of iterations.
GRID = "saturating_grid_dim"


def missing(owner: Any, names: Iterable[str]) -> str | None:
    """Returns the first dotted attribute name that the owner lacks, None if none is missing."""
    for name in names:
        try:
            operator.attrgetter(name)(owner)
        except AttributeError:
            return name
    return None


try:
    from taichi._lib import core
    from taichi.lang import expr, impl, kernel_impl, matrix_ops, snode
    from taichi.lang.ast.ast_transformer import ASTTransformer
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext, Builder
    from taichi.lang.ast.transform import transform_tree
    from taichi.lang.enums import AutodiffMode
    from taichi.lang.kernel_impl import Kernel
    from taichi.types import ndarray_type

    setters = (*SETTERS.values(), *VECTOR_SETTERS.values(), *GETTERS.values(), ARRAY_SETTER)
    _missing = (
        missing(impl, ["get_runtime"])
        or missing(AutodiffMode, ["NONE"])
        or missing(Kernel, ["ensure_compiled"])
        or missing(kernel_impl, ["getsourcelines", "getsourcefile", "textwrap", "ast"])
        or missing(kernel_impl, ["_inside_class"])
        or missing(expr, ["_check_in_range", "_clamp_unsigned_to_range"])
        or missing(impl, ["get_traceback"])
        or missing(snode, ["get_traceback"])
        or missing(ASTTransformerContext, ["get_pos_info"])
        or missing(ndarray_type, ["NdarrayType"])
        or missing(ASTTransformer, LOOPS)
        or missing(matrix_ops, ["sum", "dot", "norm", "norm_sqr", "max", "min", "matmul"])
        or missing(matrix_ops, ["_reduce", "_matmul_helper", "cross", "transpose"])
        or missing(core, [f"Program.{name}" for name in PROGRAM])
        or missing(core, ["Kernel.make_launch_context"])
        or missing(core, [f"CompileConfig.{name}" for name in (EQUAL_PARTS, GRID)])
        or missing(core, [f"KernelLaunchContext.{name}" for name in setters])
    )
except ImportError as error:
    _missing = str(error)

try:
    from taichi.ui.utils import get_field_info as _field_info
except ImportError:
    _field_info = None

if _missing:
    warnings.warn(f"Taichi {ti.__version__} lacks {_missing}: launches are slower", stacklevel=1)
# True if kernels run as plain Taichi kernels.
PLAIN = bool(_missing) or os.environ.get(SWITCH, "") not in ("", "0")


def _position(context: Any, node: Any) -> str:
    """Returns the position of a syntax node for messages: file, line, function, source line."""
    line, name = node.lineno + context.lineno_offset, context.func.func.__name__
    return f'File "{context.file}", line {line}, in {name}:\n{context.src[node.lineno - 1]}\n'


def _declaration(stacklevel: int = 1) -> str:
    """Returns the position of the program's code that declares a field, for messages."""
    frame = sys._getframe(stacklevel)
    while frame.f_back and frame.f_code.co_filename.startswith(TAICHI):
        frame = frame.f_back
    return f'File "{frame.f_code.co_filename}", line {frame.f_lineno}\n'


def _in_class_body(level_of_class_stackframe: int) -> bool:
    """Returns True if a decorated function is in the body of a class, whose statement is so many
    calls above."""
    return "__qualname__" in sys._getframe(level_of_class_stackframe - 1).f_locals


def _source_lines(function: Any) -> tuple[list[str], int]:
    """Returns the lines of a function with its decorators, and the first line's number, without
    inspect's tokens: up to the first line after its code that is not indented more than it."""
    code = function.__code__
    lines, first = linecache.getlines(code.co_filename), code.co_firstlineno - 1
    own, last = _indentation(lines[first]), _last_line(code)
    while last < len(lines) and _indentation(lines[last]) > own:
        last += 1
    return lines[first:last], first + 1


@functools.cache
def _lines_without_ends(function: Any) -> tuple[list[str], int]:
    lines, first = _source_lines(function)
    return [line.rstrip() for line in lines], first


def _indentation(line: str) -> float:
    """Returns the number of spaces before a line, infinite for blank lines and comments."""
    text = line.lstrip()
    return len(line) - len(text) if text and text[0] != "#" else math.inf


def _last_line(code: Any) -> int:
    """Returns the last line on which code starts, that of inner functions included."""
    inner = [_last_line(value) for value in code.co_consts if hasattr(value, "co_lines")]
    return max(*inner, *(line for _, _, line in code.co_lines() if line))


def _build_node(self: Any, context: Any, node: Any) -> Any:
    """Builds a syntax node; only statements have a position, not each expression."""
    method = getattr(self, f"build_{type(node).__name__}", None)
    if method is None or isinstance(node, ast.stmt):
        return build_node(self, context, node)
    return method(context, node)


# Syntax trees of functions by source, except those in use by a compilation.
_trees: dict[str, Any] = {}


def _parse(source: str) -> ast.Module:
    """Returns the syntax tree of a source."""
    tree: Any = _trees.pop(source, None) or ast.parse(source)
    tree.source = source
    return tree


def _transform(tree: Any, context: Any) -> Any:
    """Calls Taichi's transform_tree, and keeps the tree of a function for its next call. The tree
    of a kernel cannot be used again, since Taichi removes its arguments."""
    result = transform_tree(tree, context)
    if not context.is_kernel:
        _trees[tree.source] = tree
    return result


if not PLAIN:
    kernel_impl.ast, kernel_impl.transform_tree = SimpleNamespace(parse=_parse), _transform
    ASTTransformerContext.get_pos_info = _position
    build_node, Builder.__call__ = Builder.__call__, _build_node
    kernel_impl._inside_class = _in_class_body
    kernel_impl.getsourcelines = _lines_without_ends
    kernel_impl.getsourcefile = functools.cache(kernel_impl.getsourcefile)
    kernel_impl.textwrap = SimpleNamespace(
        fill=lambda line, **_: line, dedent=functools.cache(textwrap.dedent)
    )
    for name in ("_check_in_range", "_clamp_unsigned_to_range"):
        setattr(expr, name, functools.cache(getattr(expr, name)))
    impl.get_traceback = snode.get_traceback = _declaration
    from msph import taichi_matrices

    taichi_matrices.use()


def on_cpu() -> bool:
    """Returns True if kernels run on the CPU. Call after ti.init."""
    return ti.cfg.arch in (ti.x64, ti.arm64)


def on_cuda() -> bool:
    """Returns True if kernels run under CUDA. Call after ti.init."""
    return ti.cfg.arch == ti.cuda


def longest_float():
    """Returns the widest float type of kernels: f64 on CPUs and CUDA, else f32. Call after
    ti.init."""
    return ti.f64 if on_cpu() or on_cuda() else ti.f32


def cache_folder() -> Path | None:
    """Returns the folder of Taichi's kernel cache, None if unknown. Call before ti.init."""
    given = os.environ.get(TAICHI_FOLDER)
    config = getattr(getattr(ti._lib, "core", None), "default_compile_config", None)
    found = given or getattr(config() if config else None, "offline_cache_file_path", "")
    return Path(found) if found else None


def discard_cache() -> bool:
    """Removes the files of Taichi's kernel cache, and says so in one line; returns False if there
    are none. Call where Taichi fails to read them."""
    folder = cache_folder()
    files = [f for kind in CACHE_FILES for f in (folder.glob(kind) if folder else ())]
    for file in files:
        # Another process may remove the file first.
        with contextlib.suppress(OSError):
            file.unlink()
    if files:
        print(f"msph: {folder}: damaged kernels in the cache are compiled anew", file=sys.stderr)
    return bool(files)


def end() -> None:
    """Ends Taichi, which then writes its kernel cache."""
    try:
        ti.reset()
    except CACHE_ERRORS:
        discard_cache()


if not PLAIN:
    _compile_kernel = core.Program.compile_kernel

    def _compile(*arguments: Any) -> Any:
        """Compiles a kernel or reads it from the cache, which is removed if it is damaged."""
        try:
            return _compile_kernel(*arguments)
        except CACHE_ERRORS:
            if not discard_cache():
                raise
            return _compile_kernel(*arguments)

    core.Program.compile_kernel = _compile


def field_trees() -> int:
    """Returns the number of field trees that this process has allocated, 0 if unknown."""
    program = getattr(getattr(ti.lang.impl, "get_runtime", lambda: None)(), "prog", None)
    return program.get_snode_tree_size() if hasattr(program, "get_snode_tree_size") else 0


def set_image(canvas: Any, words: Any) -> None:
    """Sets the image of a GGUI canvas from packed pixels, (width, height) int32, red in the lowest
    byte. Plain GGUI packs pixels itself, one by one: 30 ms for 960x540."""
    inner = getattr(canvas, "canvas", None)
    if _field_info and not PLAIN and hasattr(inner, "set_image"):
        inner.set_image(_field_info(words.view("u4")))
    else:
        canvas.set_image(words.view("u1").reshape(*words.shape, 4))
