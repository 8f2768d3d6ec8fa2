//! Attachment of `rmw_zenoh` to each message.

/// Length of a publisher's id, bytes.
pub const GID_BYTES: usize = 16;

/// Attachment that a subscriber of `rmw_zenoh` requires: it drops messages without. Here it only
/// distinguishes publishers, if it has the present layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Attachment {
    /// Number of the publisher's message.
    pub sequence: i64,
    /// Time of sending, ns since 1970.
    pub source_ns: i64,
    /// The publisher's id.
    pub gid: [u8; GID_BYTES],
}

impl Attachment {
    /// Returns its bytes in the present layout: both numbers, little-endian, and the id behind its
    /// length.
    pub fn to_bytes(self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(17 + GID_BYTES);
        bytes.extend(self.sequence.to_le_bytes());
        bytes.extend(self.source_ns.to_le_bytes());
        bytes.push(GID_BYTES as u8);
        bytes.extend(self.gid);
        bytes
    }

    /// Reads the layout of [`Self::to_bytes`]; `None` for any other.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (sequence, bytes) = bytes.split_first_chunk()?;
        let (source_ns, bytes) = bytes.split_first_chunk()?;
        let (&length, gid) = bytes.split_first()?;
        let gid = gid.try_into().ok()?;
        (usize::from(length) == GID_BYTES).then_some(Self {
            sequence: i64::from_le_bytes(*sequence),
            source_ns: i64::from_le_bytes(*source_ns),
            gid,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_layout_is_that_of_rmw_zenoh() {
        let attachment = Attachment {
            sequence: 2,
            source_ns: -1,
            gid: [7; GID_BYTES],
        };
        let bytes = attachment.to_bytes();
        assert_eq!(bytes.len(), 33);
        assert_eq!(&bytes[..8], &[2, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(&bytes[8..16], &[255; 8]);
        assert_eq!(bytes[16], 16);
        assert_eq!(&bytes[17..], &[7; 16]);
        assert_eq!(Attachment::from_bytes(&bytes), Some(attachment));
        for wrong in [&[][..], &bytes[..32], &[0; 33], &[16; 34]] {
            assert_eq!(Attachment::from_bytes(wrong), None, "{wrong:?}");
        }
    }
}
