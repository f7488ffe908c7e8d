"""Checks that files of other programs are imported correctly, with judges that share no code with the product."""
