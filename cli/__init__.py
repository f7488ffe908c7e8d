"""The commands of ``plannerforge``: what each does, and the flags that they share."""
