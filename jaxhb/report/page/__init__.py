"""The page of a report. Answers go in; one HTML file with tables and figures comes out,
which needs no network.
"""
