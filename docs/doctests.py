"""An extension of griffe for mkdocstrings: the end of a docstring, from its first >>> on, is shown as examples."""

import re
import textwrap
from typing import Any

import griffe


class Doctests(griffe.Extension):
    """Inserts the heading `Examples:` of Google's style above the first >>> of a docstring."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Called by griffe for every object that it has read."""
        if obj.docstring and re.search(r"^>>> ", obj.docstring.value, re.MULTILINE):
            text, example = re.split(r"^(?=>>> )", obj.docstring.value, maxsplit=1, flags=re.MULTILINE)
            obj.docstring.value = f"{text}Examples:\n{textwrap.indent(example, '    ')}"
