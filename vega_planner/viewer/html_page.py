# SPDX-License-Identifier: Apache-2.0
"""The frame of self-contained pages: style, tables, figures. Readable on a phone."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

_STYLE = """
:root{color-scheme:light}
body{font:16px/1.5 system-ui,sans-serif;color:#1c2430;background:#fff;margin:0 auto;
max-width:60rem;padding:1rem}
h1{font-size:1.5rem;margin:.2em 0}h2{font-size:1.15rem;margin:1.6em 0 .4em}
.lead{color:#46505e;margin:.2em 0 1em}
.row{display:flex;flex-wrap:wrap;gap:.8rem}
figure{margin:0;flex:1 1 17rem;max-width:100%;min-width:0}
figure img,figure svg{width:100%;height:auto;border:1px solid #dfe3e8;border-radius:6px}
figure svg{display:block;max-width:26rem;margin:0 auto}
figcaption{font-size:.9rem;color:#46505e;padding:.2em 0}
.scroll{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
th,td{text-align:left;padding:.3em .6em;border-bottom:1px solid #e6e9ed;vertical-align:top}
td.n,th.n{text-align:right}
.badge{display:inline-block;border-radius:1em;padding:.1em .8em;color:#fff;font-weight:600}
.good{background:#2b7a3d}.fair{background:#9a6700}.bad{background:#b3261e}
li{margin:.25em 0}
"""


def page(title: str, lead: str, sections: Iterable[str]) -> bytes:
    """Put a page together.

    Args:
        title: Plain text.
        lead: Plain text below the title.
        sections: HTML.
    """
    body = "\n".join(sections)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{text(title)}</title><style>{_STYLE}</style></head><body>"
        f'<h1>{text(title)}</h1><p class="lead">{text(lead)}</p>\n{body}\n</body></html>\n'
    ).encode()


def text(value: object) -> str:
    """Escape plain text."""
    return html.escape(str(value))


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Make a table; numbers and all columns but the first are right-aligned."""

    def cells(values: Sequence[object], tag: str) -> str:
        return "".join(
            f"<{tag}{' class=n' if column else ''}>{text(value)}</{tag}>"
            for column, value in enumerate(values)
        )

    body = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    top = f"<thead><tr>{cells(head, 'th')}</tr></thead>" if head else ""
    return f'<div class="scroll"><table>{top}<tbody>{body}</tbody></table></div>'


def figure(content: str, caption: str) -> str:
    """Put a caption below an image source (data URI) or an SVG."""
    inner = content if content.startswith("<") else f'<img alt="{text(caption)}" src="{content}">'
    return f"<figure>{inner}<figcaption>{text(caption)}</figcaption></figure>"


def row(figures: Iterable[str]) -> str:
    """Put figures side by side where there is room."""
    return f'<div class="row">{"".join(figures)}</div>'


def bullets(items: Iterable[object]) -> str:
    """Make a list of plain texts."""
    return "<ul>" + "".join(f"<li>{text(item)}</li>" for item in items) + "</ul>"
