"""Loop in time: devices, plants, hands, the servo, and the rows of recordings."""
