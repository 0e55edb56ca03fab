"""Style sheets of both pages. The dark style inverts the lightness of plots, not their hue."""

_LIGHT = """{ --ground: #ffffff; --text: #1b1f24; --faint: #59636e; --line: #d5dae0;
  --soft: #f3f5f8; --strong: #0b5394; --warn: #8a3800; --plot: none; color-scheme: light }
"""

# Print is always light. The ground of the dark style is inverted white.
TOKENS = """
:root """ + _LIGHT + """
:root.dark { --ground: #141414; --text: #e8eaed; --faint: #a4abb5; --line: #333b45;
  --soft: #1d232a; --strong: #7cc4f5; --warn: #ffb37a;
  --plot: invert(.92) hue-rotate(180deg); color-scheme: dark }
@media print { :root.dark """ + _LIGHT + """}
"""

# Chooses the dark style if the browser prefers it.
PREFER_DARK = "if (matchMedia('(prefers-color-scheme: dark)').matches) " \
    "document.documentElement.classList.add('dark')"

# In print, plots are unbroken, and tools and controls are hidden.
PLOT = ':host { filter: var(--plot); break-inside: avoid }'
TOOLS = ':host { filter: var(--plot) } @media print { :host { display: none } }'

CONTENT = """
h1 { font-size: clamp(1.1rem, 2.4vw, 1.5rem); line-height: 1.25; margin: .2rem 0 .6rem }
h2 { font-size: 1.15rem; margin: 2rem 0 .4rem; border-bottom: 1px solid var(--line);
  padding-bottom: .2rem }
h3 { font-size: 1rem; margin: 1rem 0 .3rem }
p { margin: .4rem 0; max-width: 75em }
h1, h2, h3, p, li, summary { overflow-wrap: anywhere }
.quiet { color: var(--faint) }
.warning { color: var(--warn) }
.wide { overflow-x: auto; margin: .6rem 0 }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
th, td { padding: .22rem .7rem .22rem 0; text-align: left; vertical-align: top;
  border-bottom: 1px solid var(--line); overflow-wrap: break-word; min-width: 3.5em;
  max-width: 42em }
thead th { color: var(--faint); font-weight: 500; white-space: normal }
tbody th { font-weight: 500; white-space: nowrap; max-width: 24em; overflow: hidden;
  text-overflow: ellipsis }
.number { text-align: right }
td.number { white-space: nowrap }
/* On a narrow page a table scrolls before its text is one word wide. */
td:not(.number) { min-width: 9em }
tr.strong th, tr.strong td { font-weight: 700 }
tr[style] > td:first-of-type { background: linear-gradient(to left, var(--line) var(--bar),
  transparent 0); min-width: 8em; padding-left: .7rem; print-color-adjust: exact }
.key { display: flex; flex-wrap: wrap; gap: .3rem 1.1rem }
.key i { display: inline-block; width: .85em; height: .85em; border-radius: 2px;
  margin-right: .35em; vertical-align: -.05em; border: 1px solid var(--line);
  filter: var(--plot); print-color-adjust: exact; -webkit-print-color-adjust: exact }
.equation { overflow-wrap: break-word; padding-left: 1.5em; text-indent: -1.5em }
details { margin: .3rem 0 .6rem }
summary { cursor: pointer; color: var(--strong) }
pre { background: var(--soft); padding: .6rem .8rem; border-radius: 4px;
  white-space: pre-wrap; overflow-wrap: anywhere }
.command { display: flex; gap: .6rem; align-items: start; max-width: 75em }
.command pre { flex: 1; margin: 0 }
.copy { font: inherit; color: var(--text); background: var(--soft); padding: .45rem .9rem;
  border: 1px solid var(--line); border-radius: 4px; cursor: pointer }
.copy:hover { border-color: var(--strong) }
ul { margin: .3rem 0; padding-left: 1.3rem }
:focus-visible { outline: 2px solid var(--strong); outline-offset: 2px }
"""

# Arrow of drop-down lists, visible on light and dark background; Bokeh's own is black.
ARROW = """
select.bk-input:not([multiple]) { background-image: url('data:image/svg+xml;utf8,<svg \
viewBox="0 0 25 20" xmlns="http://www.w3.org/2000/svg"><path d="M 0,0 25,0 12.5,20 Z" \
fill="gray"/></svg>') }
"""

# Controls of plots.
CONTROL = """
:host { color: var(--text) }
.bk-input { background-color: var(--ground); color: var(--text); border-color: var(--line) }
@media print { :host { display: none } }
""" + ARROW

REPORT = TOKENS + """
:root { --top: 3.4rem }
* { box-sizing: border-box }
body { margin: 0; background: var(--ground); color: var(--text);
  font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif }
main { max-width: 1400px; margin: 0 auto; padding: 1rem 1.4rem 4rem }
nav { display: flex; flex-wrap: wrap; gap: .2rem 1rem; padding: .3rem 0 }
a { color: var(--strong) }
.plots { margin: .6rem 0 }
#joint { position: sticky; top: 0; z-index: 6; background: var(--ground); padding: .2rem 0 }
section { scroll-margin-top: 4rem }
""" + CONTENT + """
@media print {
  @page { size: A4 landscape; margin: 12mm }
  main { max-width: none; padding: 0 }
  nav, .copy, #joint { display: none }
  .wide { overflow: visible }
  .plots { max-width: 100%; overflow: visible }
  details > *:not(summary) { display: none }
  h1, h2, h3, .key, thead { break-after: avoid }
  tr, .command { break-inside: avoid }
  body { font-size: 11px }
}
"""
