"""Any set of estimators on the same logs, through the one interface that all of them satisfy."""
