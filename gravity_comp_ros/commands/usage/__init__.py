"""What each verb takes: light modules, so that help and wrong usage load no science."""
