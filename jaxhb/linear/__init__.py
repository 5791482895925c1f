"""Modal analysis and the response as the engineer reads it."""
