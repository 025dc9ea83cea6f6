"""Records, histories and figures as data: what is read before anything is judged."""
