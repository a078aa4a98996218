"""Generate reference tables from the code. The result of the function NAME replaces `<!-- generated NAME -->`."""

import html
import json
import re
from typing import Any

import typer
from sphinx.application import Sphinx
from typer.cli import get_docs_for_click

import dfd
from dfd.cli import app as commands
from dfd.distillation.settings import source_of
from dfd.editing.controls import CONTROLS

MARK = re.compile(r"^<!-- generated (\w+) -->$", re.MULTILINE)
Schema = dict[str, Any]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the function that inserts the generated text when Sphinx reads a page."""
    app.connect("source-read", _put_in)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _put_in(app: Sphinx, name: str, source: list[str]) -> None:
    source[0] = MARK.sub(lambda mark: globals()[mark[1]](), source[0])


def command_line() -> str:
    """Return every command with its options, as in `--help`."""
    group = typer.main.get_command(commands)
    text = get_docs_for_click(obj=group, ctx=typer.Context(group), name="dfd")
    text = html.unescape(text[text.index("## `dfd ") :])
    return re.sub(r"^\*\*(\w+)\*\*:$", r"\1:", text, flags=re.MULTILINE)


def edit_file() -> str:
    """Return tables of all objects in an edit file, first the edit itself."""
    schema = dfd.edit_schema()
    return _object("Edit", schema) + "".join(_object(*each) for each in schema.get("$defs", {}).items())


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


def _object(name: str, schema: Schema) -> str:
    """Return the heading, the description and the table of fields of one definition in the schema."""
    text = f"\n## {name}\n\n{_sentence(schema)}\n"
    if fields := schema.get("properties"):
        text += "\n| field | type | default | what it is |\n|---|---|---|---|\n"
        required = schema.get("required", ())
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
