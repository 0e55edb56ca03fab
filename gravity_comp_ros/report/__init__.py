"""The report: a comparison or diagnosis as one HTML file; needs Bokeh (extra `report`)."""
