"""How an answer is told. A train and what is asked go in; answers come out, and of
these text, files, figures and pages.
"""
