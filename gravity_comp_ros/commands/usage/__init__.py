"""Arguments and help text of each verb; these modules import no numerical code."""
