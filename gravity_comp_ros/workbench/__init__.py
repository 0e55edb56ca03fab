"""The workbench: compare, diagnose, add and undo in a browser; needs Bokeh (extra `report`)."""
