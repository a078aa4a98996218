"""Write reference tables, which come from the code, into the pages: `python docs/tools/generated.py`.

The result of the function NAME stands between `<!-- generated NAME -->` and `<!-- end -->`. `make docs` calls this
file, and a test fails if a page is stale.
"""

import html
import inspect
import json
import re
from pathlib import Path
from typing import Any

import typer
from typer.cli import get_docs_for_click

import dfd
from dfd.cli import app as commands
from dfd.distillation.settings import source_of
from dfd.editing.controls import CONTROLS

PAGES = Path(__file__).resolve().parents[1]
MARK = re.compile(r"(^<!-- generated (\w+) -->\n).*?(^<!-- end -->$)", re.MULTILINE | re.DOTALL)
Schema = dict[str, Any]
PARTS = ("Place", "Transform", "Controls")  # definitions whose fields others contain


def main() -> None:
    """Write the present tables into all pages."""
    for page in PAGES.rglob("*.md"):
        text = page.read_text("utf-8")
        if (now := with_tables(text)) != text:
            page.write_text(now, "utf-8")


def with_tables(text: str) -> str:
    """Return the text of a page with the present tables."""
    return MARK.sub(lambda mark: f"{mark[1]}\n{globals()[mark[2]]().strip()}\n\n{mark[3]}", text)


def command_line() -> str:
    """Return every command with its options, as in `--help`."""
    group = typer.main.get_command(commands)
    text = get_docs_for_click(obj=group, ctx=typer.Context(group), name="dfd")
    text = html.unescape(text[text.index("## `dfd ") :])
    text = re.sub(r"```console\n\$ (.*)\n```", r"`\1`", text)
    text = re.sub(r"^\*\*Usage\*\*:\n\n|^\* `--help`: .*\n", "", text, flags=re.MULTILINE)
    return re.sub(r"^\*\*(\w+)\*\*:$", r"\1:", text, flags=re.MULTILINE)


def python_names() -> str:
    """Return a table of the public names with the first sentence of each docstring."""
    rows = [f"| `{name}` | {_first(getattr(dfd, name))} |" for name in sorted(dfd.__all__, key=str.lower)]
    return "\n".join(["| name | what it is |", "|---|---|", *rows])


def _first(thing: Any) -> str:
    """Return the first sentence of a docstring."""
    return " ".join((inspect.getdoc(thing) or "").partition("\n\n")[0].split()).replace("|", "\\|")


def edit_file() -> str:
    """Return tables of all objects in an edit file, first the edit itself."""
    schema = dfd.edit_schema()
    own = schema.get("$defs", {})
    return _object("Edit", schema, own) + "".join(_object(name, each, own) for name, each in own.items())


def controls() -> str:
    """Return a table of the controls of a handle with their descriptions."""
    rows = [f"| `{name}` | {about.text} |" for name, about in CONTROLS.items()]
    return "\n".join(["| control | what it does |", "|---|---|", *rows]) + "\n"


def distill_settings() -> str:
    """Return a table of the settings of a distillation, with their values in both presets and the paper's source."""
    rows = ["| setting | default | paper | source of *paper* | what it is |", "|---|---|---|---|---|"]
    default, paper = dfd.DistillSettings(), dfd.DistillSettings(preset="paper")
    for name, about in dfd.DistillSettings.model_fields.items():
        if name != "preset":
            values = f"{getattr(default, name)} | {getattr(paper, name)}"
            rows.append(f"| `{name}` | {values} | {source_of(name)} | {about.description} |")
    return "\n".join(rows) + "\n"


def _object(name: str, schema: Schema, others: dict[str, Schema]) -> str:
    """Return the heading, the description and the table of fields of one definition in the schema.

    If it has all fields of one of `PARTS`, a row names this definition in place of these fields.
    """
    text = f"\n## {name}\n\n{_sentence(schema)}\n"
    if fields := schema.get("properties"):
        text += "\n| field | type | default | what it is |\n|---|---|---|---|\n"
        required = schema.get("required", ())
        for part in PARTS:
            inside = others[part]["properties"]
            if name != part and inside.items() <= fields.items():
                fields = {field: about for field, about in fields.items() if field not in inside}
                text += f"| the fields of [{part}](#{part.lower()}) | | | |\n"
        for field, about in fields.items():
            default = f"`{json.dumps(about['default'], ensure_ascii=False)}`" if "default" in about else ""
            default = "required" if field in required else default if len(default) < 40 else "see its type"
            text += f"| `{field}` | {_type(about)} | {default} | {_sentence(about)} |\n"
    elif "enum" in schema:
        text += f"\n{_type(schema)}\n"
    return text


def _sentence(schema: Schema) -> str:
    first = schema.get("description", "").partition("\n\n")[0]
    return " ".join(first.split()).replace("|", "\\|")


def _type(schema: Schema) -> str:
    """Return the type that a JSON Schema defines, as Markdown."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "const" in schema:
        return f"`{json.dumps(schema['const'])}`"
    if "enum" in schema:
        return ", ".join(f"`{json.dumps(each)}`" for each in schema["enum"])
    if alternatives := schema.get("anyOf") or schema.get("oneOf"):
        return ", ".join(dict.fromkeys(map(_type, alternatives)))
    if schema.get("type") == "array":
        if "prefixItems" in schema:
            return f"[{', '.join(map(_type, schema['prefixItems']))}]"
        return f"list of {_type(schema.get('items', {}))}"
    bounds = [
        f"{sign} {schema[key]:g}"
        for key, sign in (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤"), ("exclusiveMaximum", "<"))
        if key in schema and abs(schema[key]) < 1e15
    ]
    return " ".join([schema.get("type", "anything"), *bounds])


if __name__ == "__main__":
    main()
