"""What a check comes to."""

#: As predicted; not so; results that it needs are not there, or a cell is not ok;
#: theory predicts nothing: a value that is shown, not checked.
PASS, MISS, INCOMPLETE, SHOWN = "pass", "miss", "incomplete", "shown"
