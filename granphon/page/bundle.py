"""One file from many: modules of JavaScript are joined, libraries wrapped, and all of it is put into the page's template."""

from __future__ import annotations

import json
import re
from html import escape
from importlib.resources import files
from typing import Any

#: an import of other modules of the page, on one line
_IMPORT = re.compile(r'^import \{[^}]*\} from "\./(\w+)\.js";\n', re.MULTILINE)
#: libraries: what is imported from another file, what is exported from it, and what a file exports itself
_TAKEN = re.compile(r'import\{([^}]*)\}from"[^"]*";')
_PASSED_ON = re.compile(r'export\{[^}]*\}from"[^"]*";')
_GIVEN = re.compile(r"export\{([^}]*)\};")


def read_asset(name: str) -> str:
    """Return the text of a file of the folder ``assets``."""
    return files("granphon.page").joinpath("assets", *name.split("/")).read_text(encoding="utf-8")


def join_modules(*names: str) -> str:
    """Return the text of modules of the folder ``assets`` and of those that they import, each once and after its imports.

    A module begins with its imports, one on a line, and exports by the word ``export``. Joined, all modules share their
    names, so that no two of them may have the same one.
    """
    parts: list[str] = []
    done: set[str] = set()

    def add(name: str) -> None:
        if name in done:
            return
        done.add(name)
        text = read_asset(f"{name}.js")
        for other in _IMPORT.findall(text):
            add(other)
        parts.append(re.sub(r"^export ", "", _IMPORT.sub("", text), flags=re.MULTILINE))

    for name in names:
        add(name)
    return "\n".join(parts)


def wrap_three() -> str:
    """Return three.js, of two modules, as a script that defines the object ``THREE``."""
    core = _GIVEN.sub(lambda found: f"return{{{_swap(found[1])}}};", read_asset("vendor/three.core.min.js"))
    module = read_asset("vendor/three.module.min.js")
    module = _TAKEN.sub(lambda found: f"const{{{found[1].replace(' as ', ':')}}}=core;", module)
    module = _GIVEN.sub(lambda found: f"return{{...core,{_swap(found[1])}}};", _PASSED_ON.sub("", module))
    return f"const THREE=((core)=>{{{module}}})((()=>{{{core}}})());"


def _swap(names: str) -> str:
    """Return "B:a,C", the members of an object, for the "a as B,C" of an export."""
    pairs = (name.split(" as ") for name in names.split(","))
    return ",".join(pair[0] if len(pair) == 1 else f"{pair[1]}:{pair[0]}" for pair in pairs)


def fill_template(data: dict[str, Any], title: str) -> str:
    """Return the page, with all that it needs inside: libraries, program, and ``data`` as JSON."""
    parts = {
        "title": escape(title, quote=False),
        "style": read_asset("style.css"),
        "licences": "\n\n".join(read_asset(f"vendor/{name}.LICENSE").strip() for name in ("plotly", "three")),
        "plotly": read_asset("vendor/plotly-basic.min.js"),
        "three": wrap_three(),
        # "<" would end the element, as "</script>"; JSON reads \\u003c as the same character
        "data": json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        "program": join_modules("main"),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], read_asset("template.html"))
