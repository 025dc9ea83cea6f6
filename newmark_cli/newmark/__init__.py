"""The numerical core: integrators, forms, scalings, orders, the march, measures."""
