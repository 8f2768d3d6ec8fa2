//! What travels: message types, CDR and JSON codecs, key expressions. No I/O.
