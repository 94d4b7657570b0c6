"""Pages of a lesson: a band below the image for the question and tasks, and full-window pages for
the explanation. Text is at least 18 pixels high in a window of 960 x 540 pixels."""

import textwrap
from typing import Any

from PIL import Image, ImageFont

from msph.lesson import typeset
from msph.lesson.course import LessonProgress
from msph.lesson.schema import Lesson
from msph.stage.sheet import AWAY, FAINT, INK, LINE, SOLID, WARNING, Sheet, font_of, wrapped

# Lines of text in the band, share of its width for the caption, and padding in text heights.
LINES, CAPTION, PAD = 8.4, 0.56, 0.6
# Widths of a slider's name and of its value, in text heights.
NAME, VALUE = 5.8, 6.6
# Height of a formula over text height; extra indent of continued lines of code, in columns.
FORMULA, FOLD = 1.5, 8
# Colour of correct answers and completed tasks, which are also marked by words and shapes.
DONE = (124, 214, 160, 255)
LETTERS = "abcd"
# State of a task whose simulations stand still.
STARTS = "still: move a slider, tilt or push"


def band_height(text: int) -> int:
    """Returns the height of the band for a text height, both in pixels."""
    return round(LINES * LINE * text)


class TaskBar:
    """Painter of the band; size (width, height) and text height [pixels]."""

    def __init__(self, size: tuple[int, int], text: int):
        self.size, self.text = size, text
        self.keys = True  # False hides the line of keys

    def paint(self, progress: LessonProgress, shown: list[str], waits: bool = False) -> Sheet:
        """Returns the band; shown: lines with the numbers of a task; waits: the simulations stand
        still until the user acts."""
        self.sheet = Sheet(self.size, self.text, SOLID)
        pad, middle = PAD * self.text, CAPTION * self.size[0]
        width = middle - 2 * pad
        lesson, task = progress.lesson, progress.task
        caption = task.text if task else lesson.predict.ask
        where = f"task {progress.page} of {len(lesson.do)}" if task else "question"
        y = self.sheet.write_wrapped([f"{lesson.title}: {where}"], pad, pad, WARNING, width)
        self.sheet.write_wrapped([caption], pad, y + 0.2 * self.text, INK, width)
        right = self.size[0] - middle - pad
        if task:
            y = self._sliders(progress, middle, pad, right)
            done = progress.ticked[progress.page - 1]
            if done:
                y = self._tick("done at" if shown else "done before", True, middle, y)
            y = self.sheet.write_wrapped(shown, middle, y, DONE if done else INK, right)
            if not done:
                self._tick(STARTS if waits else "not done", False, middle, y)
        else:
            self._choices(progress, middle, pad, right)
        low = self.size[1] - pad - self.text
        if self.keys:
            self.sheet.write_wrapped([keys_of(progress)], pad, low, FAINT, width)
        return self.sheet

    def _choices(self, progress: LessonProgress, x: float, y: float, width: float) -> None:
        """Draws all choices; once answered, the chosen one with its reason and the correct one."""
        predict, chosen = progress.lesson.predict, progress.answered
        for k, choice in enumerate(predict.choices, 1):
            text, right = f"{LETTERS[k - 1]}) {choice}", k == predict.answer
            if not chosen:
                y = self.sheet.write_wrapped([text], x, y, INK, width)
            elif k == chosen:
                mark, colour = ("correct", DONE) if right else ("not correct", WARNING)
                y = self.sheet.write_wrapped([f"{text} - {mark}"], x, y, colour, width)
                y = self.sheet.write_wrapped([predict.because[k - 1]], x, y, INK, width)
            elif right:
                y = self.sheet.write_wrapped([f"{text} - correct"], x, y, DONE, width)

    def _sliders(self, progress: LessonProgress, x: float, y: float, width: float) -> float:
        for slider in progress.lesson.slider:
            value = progress.values[slider.name]
            ends = x + NAME * self.text, x + width - VALUE * self.text
            self.sheet.write(x, y, slider.name.replace("_", " "))
            self.sheet.slider(slider.name, value, (slider.lo, slider.hi), ends, y)
            label = progress.reading(slider.name, float(f"{value:.3g}"))
            self.sheet.write(ends[1] + AWAY * self.text, y, label, FAINT)
            y += LINE * self.text
        return y

    def _tick(self, state: str, done: bool, x: float, y: float) -> float:
        """Draws the check box of a task and its state, and returns the y below."""
        edge = 0.8 * self.text
        top = y + 0.5 * (LINE * self.text - edge)
        colour = DONE if done else FAINT
        draw = self.sheet.draw
        draw.rectangle((x, top, x + edge, top + edge), None, colour, 2)
        if done:
            a, b = 0.2 * edge, 0.42 * edge
            tick = (x + a, top + 0.5 * edge, x + b, top + 0.75 * edge, x + edge, top)
            draw.line(tick, colour, 3)
        return self.sheet.write_wrapped([state], x + 1.5 * edge, y, colour, self.size[0])


def keys_of(progress: LessonProgress) -> str:
    """Returns the keys that can be used on the current page, with their actions."""
    if progress.page == 0 and not progress.answered:
        return f"your answer? {', '.join(LETTERS[: len(progress.lesson.predict.choices)])}"
    keys = ["n: next"] if progress.page + 1 < progress.pages else ["q: end the lesson"]
    keys += ["b: back"] if progress.page else []
    keys += ["r: restart"] if progress.task else []
    return ", ".join(keys)


class Reasons:
    """Painter of the explanation: caption, formula and code, on as many pages as the code needs;
    size (width, height) and text height [pixels]."""

    def __init__(self, lesson: Lesson, code: list[str], size: tuple[int, int], text: int):
        self.lesson, self.size, self.text = lesson, size, text
        self.pitch, self.keys = 1.2 * text, True
        self.mono = code_font(text)
        columns = int((size[0] - 2 * PAD * text) / self.mono.getlength("x"))
        code = [part for line in code for part in folded(line, columns)]
        self.head = self._head()
        first = max(1, int((size[1] - self.head.height - 2.6 * text) / self.pitch))
        rest = int((size[1] - 3.0 * text) / self.pitch)
        self.parts = [code[:first]]
        while code[first:]:
            self.parts.append(code[first : first + rest])
            first += rest

    @property
    def pages(self) -> int:
        return len(self.parts)

    def _head(self) -> Image.Image:
        """Returns the image of caption and formula."""
        width, pad = self.size[0], PAD * self.text
        lines = wrapped(self.lesson.why.text, font_of(self.text), width - 2 * pad)
        formula = Image.fromarray(
            typeset.pixels(self.lesson.why.formula, round(FORMULA * self.text), "#f5f7fa")
        )
        most = width - 2 * pad
        if formula.width > most:
            formula = formula.resize((int(most), round(formula.height * most / formula.width)))
        top = pad + LINE * self.text * (len(lines) + 1)
        sheet = Sheet((width, top + formula.height + pad), self.text, SOLID)
        texts = [(f"{self.lesson.title}: why", WARNING), *((line, INK) for line in lines)]
        for k, (line, colour) in enumerate(texts):
            sheet.write(pad, pad + sheet.pitch * k, line, colour)
        sheet.image.alpha_composite(formula, (int(pad), round(top)))
        return sheet.image

    def paint(self, number: int, progress: LessonProgress) -> Sheet:
        """Returns page `number`, from 0."""
        sheet = Sheet(self.size, self.text, SOLID)
        draw, font, pad = sheet.draw, sheet.font, PAD * self.text
        y = pad
        if number == 0:
            sheet.image.paste(self.head, (0, 0))
            y = self.head.height
        source = self.lesson.why.code.replace(":", ": ")
        draw.text((pad, y + 0.5 * self.text), source, FAINT, font, "lm")
        y += 1.2 * self.text
        for line in self.parts[number]:
            draw.text((pad, y), line, INK, self.mono)
            y += self.pitch
        low = self.size[1] - 0.7 * self.text
        if self.keys:
            draw.text((self.size[0] - pad, low), keys_of(progress), FAINT, font, "rm")
        return sheet


def code_font(text: int) -> Any:
    """Returns a monospaced font of a text height [pixels]."""
    from matplotlib.font_manager import findfont

    return ImageFont.truetype(findfont("DejaVu Sans Mono"), text)


def folded(line: str, columns: int) -> list[str]:
    """Returns a line of code in lines of at most `columns`, indented further after the first."""
    indent = " " * (len(line) - len(line.lstrip()) + FOLD)
    return textwrap.wrap(line, columns, subsequent_indent=indent, drop_whitespace=False) or [""]
