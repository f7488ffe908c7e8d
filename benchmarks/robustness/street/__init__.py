"""An exposed server: strangers, foreign archives and answers, planner programs and kills."""
