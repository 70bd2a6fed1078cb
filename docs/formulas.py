"""Formulas as MathML, which browsers draw by themselves: no script is loaded."""

from collections.abc import Callable
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx


def _drawn(as_block: bool) -> Callable[[Any, nodes.Element], None]:
    def visit(page: Any, node: nodes.Element) -> None:
        page.body.append(tex2mathml(node.astext(), as_block=as_block))
        raise nodes.SkipNode

    return visit


def setup(app: Sphinx) -> dict[str, bool]:
    """What Sphinx calls."""
    app.add_html_math_renderer("mathml", (_drawn(as_block=False), None), (_drawn(as_block=True), None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
