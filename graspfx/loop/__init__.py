"""Control loop: devices, plants, hands, the servo, and the rows of recordings."""
