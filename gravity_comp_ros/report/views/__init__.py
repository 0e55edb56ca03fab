"""Views of a report, one per file: functions from contents to a titled section of the page."""
