"""The command line: ``jaxhb scenes | scene | modes | solve | ...``. Words typed at a
terminal go in; a command, its output and an exit status come out.
"""
