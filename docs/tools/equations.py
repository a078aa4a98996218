"""Write equations as MathML, which browsers draw without a script from another server."""

from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer "mathml" for equations in HTML."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _block(writer: Any, node: nodes.math_block) -> None:
    equation, _, tag = node.astext().partition(r"\tag")
    number = f"<span>({tag.strip('{}')})</span>" if tag else ""
    writer.body.append(f'<div class="math">{tex2mathml(equation, as_block=True)}{number}</div>')
    raise nodes.SkipNode
