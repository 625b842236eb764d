"""Recordings and live robots come in; audits, calibrated detectors and served cells go out."""
