"""Pages of docs/ that run as notebooks, and so need not run once more block by block."""

PAGES = ("tutorial", "coming-from-filterpy", "coming-from-simulink", "feedback")
