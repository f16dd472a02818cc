"""For mkdocstrings: what stands after >>> at the end of a docstring is an example."""

import re
import textwrap
from typing import Any

import griffe


class Doctests(griffe.Extension):
    """Puts a heading above the examples, by which Google's style knows them."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Griffe calls this for everything that it has read."""
        if obj.docstring and re.search(r"^>>> ", obj.docstring.value, re.MULTILINE):
            text, example = re.split(r"^(?=>>> )", obj.docstring.value, maxsplit=1, flags=re.MULTILINE)
            obj.docstring.value = f"{text}Examples:\n{textwrap.indent(example, '    ')}"
