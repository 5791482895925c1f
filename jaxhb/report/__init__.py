"""How an answer is told. Answers go in; text, files, figures and pages come out."""
