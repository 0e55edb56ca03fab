"""Facts about a recording that decide how it is read: corrected, noted or refused."""
