"""Goals of a fleet: which robot executes which, over an etcd that all robots reach."""
