"""The page of a report: one HTML file with tables and figures, which needs no network."""
