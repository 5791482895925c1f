"""Reports. A train and options go in; answers come out, and of these text, files,
figures and pages.
"""
