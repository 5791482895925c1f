"""Campaigns: the answers of very many trains and speeds. A study goes in, and rows of a
folder come out, by whatever runs independent parts.
"""
