"""Hand a file to the browser; nothing is written on this side."""

from __future__ import annotations

from bokeh.models import CustomJS, Div

_SAVE = """
if (cb_obj.tags.length < 3) return
const [name, kind, text] = cb_obj.tags
const link = document.createElement('a')
link.href = URL.createObjectURL(new Blob([text], {type: kind}))
link.download = name
link.click()
setTimeout(() => URL.revokeObjectURL(link.href), 10000)
cb_obj.tags = []
"""


class Downloads:
    """An invisible part of the page through which files go out."""

    def __init__(self) -> None:
        self.element = Div(visible=False, tags=[])
        self.element.js_on_change('tags', CustomJS(code=_SAVE))

    def give(self, name: str, kind: str, text: str) -> None:
        """Let the browser save `text` as a file of that name."""
        self.element.tags = []
        self.element.tags = [name, kind, text]
