//! model.glb: binary glTF 2.0 with embedded JPEG textures, one mesh, node and material per chunk.
//!
//! Materials are unlit (`KHR_materials_unlit`, with a plain rough material for viewers that do not know it): the light
//! is in the photos already. Front faces only, so that from outside one looks through the near wall.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use gltf_json as json;
use json::validation::{Checked, USize64};
use serde_json::json as value;

use super::ChunkSink;
use super::error::{ModelError, at_path};
use super::mesh::{Chunk, Vertex};

const MAGIC: &[u8; 4] = b"glTF";
const VERSION: u32 = 2;
const JSON_CHUNK: &[u8; 4] = b"JSON";
const BINARY_CHUNK: &[u8; 4] = b"BIN\0";
/// Header of the file and of its two chunks.
const FRAMING_BYTES: u64 = 12 + 8 + 8;

/// Writes `model.glb` chunk by chunk: what a chunk weighs leaves memory at once, its description waits for the end.
pub(super) struct GlbWriter {
    path: PathBuf,
    builder: Builder,
    /// The binary chunk, without a name, so that a killed run leaves nothing of it.
    binary: BufWriter<File>,
}

impl GlbWriter {
    /// Prepares the file.
    pub(super) fn create(path: &Path) -> Result<Self, ModelError> {
        // Beside the file that it becomes a part of: on the same disk.
        let folder = path.parent().unwrap_or(Path::new("."));
        let binary = tempfile::tempfile_in(folder).map_err(at_path(folder))?;
        Ok(Self { path: path.to_owned(), builder: Builder::default(), binary: BufWriter::new(binary) })
    }

    fn assemble(&mut self, text: &[u8], binary_bytes: u32, length: u32) -> io::Result<()> {
        let binary = self.binary.get_mut();
        binary.seek(SeekFrom::Start(0))?;
        let mut file = BufWriter::new(File::create(&self.path)?);
        file.write_all(MAGIC)?;
        file.write_all(&VERSION.to_le_bytes())?;
        file.write_all(&length.to_le_bytes())?;
        file.write_all(&(text.len() as u32).to_le_bytes())?;
        file.write_all(JSON_CHUNK)?;
        file.write_all(text)?;
        file.write_all(&binary_bytes.to_le_bytes())?;
        file.write_all(BINARY_CHUNK)?;
        io::copy(binary, &mut file)?;
        file.flush()
    }
}

impl ChunkSink for GlbWriter {
    fn add(&mut self, chunk: &Chunk) -> Result<(), ModelError> {
        for part in self.builder.add(chunk) {
            self.binary.write_all(&part).map_err(at_path(&self.path))?;
        }
        checked_length(0, self.builder.length).map(|_| ())
    }

    fn finish(mut self: Box<Self>) -> Result<(), ModelError> {
        self.binary.flush().map_err(at_path(&self.path))?;
        let binary_bytes = self.builder.length;
        let mut text = std::mem::take(&mut self.builder).finish()?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let length = checked_length(text.len() as u64, binary_bytes)?;
        self.assemble(&text, binary_bytes as u32, length).map_err(at_path(&self.path))
    }
}

/// The file's length, which has 32 bits.
fn checked_length(text_bytes: u64, binary_bytes: u64) -> Result<u32, ModelError> {
    let bytes = FRAMING_BYTES + text_bytes + binary_bytes;
    u32::try_from(bytes).map_err(|_| ModelError::TooLarge { bytes })
}

/// The description under way, and the parts of the binary chunk that were not written yet, each padded to four bytes.
struct Builder {
    root: json::Root,
    buffer: json::Index<json::Buffer>,
    sampler: json::Index<json::texture::Sampler>,
    nodes: Vec<json::Index<json::Node>>,
    parts: Vec<Vec<u8>>,
    /// Bytes of the binary chunk so far.
    length: u64,
}

impl Default for Builder {
    fn default() -> Self {
        let mut root = json::Root::default();
        root.asset.generator = Some(concat!("adit ", env!("CARGO_PKG_VERSION")).to_owned());
        root.extensions_used = vec!["KHR_materials_unlit".to_owned()];
        let buffer = root.push(json::Buffer {
            byte_length: USize64(0),
            name: None,
            uri: None,
            extensions: None,
            extras: json::Extras::default(),
        });
        let sampler = root.push(json::texture::Sampler {
            mag_filter: Some(Checked::Valid(json::texture::MagFilter::Linear)),
            min_filter: Some(Checked::Valid(json::texture::MinFilter::LinearMipmapLinear)),
            wrap_s: Checked::Valid(json::texture::WrappingMode::ClampToEdge),
            wrap_t: Checked::Valid(json::texture::WrappingMode::ClampToEdge),
            ..Default::default()
        });
        Self { root, buffer, sampler, nodes: Vec::new(), parts: Vec::new(), length: 0 }
    }
}

impl Builder {
    /// Describes a chunk; returns the parts of the binary chunk that it adds.
    fn add(&mut self, chunk: &Chunk) -> Vec<Vec<u8>> {
        let positions = self.vectors(&chunk.vertices, |vertex| vertex.position, true);
        let normals = self.vectors(&chunk.vertices, |vertex| vertex.normal, false);
        let uvs = self.vectors(&chunk.vertices, |vertex| vertex.uv, false);
        let indices = self.indices(&chunk.indices);
        let material = self.material(chunk);
        let semantics = [
            (json::mesh::Semantic::Positions, positions),
            (json::mesh::Semantic::Normals, normals),
            (json::mesh::Semantic::TexCoords(0), uvs),
        ];
        let primitive = json::mesh::Primitive {
            attributes: semantics.map(|(semantic, accessor)| (Checked::Valid(semantic), accessor)).into(),
            indices: Some(indices),
            material: Some(material),
            mode: Checked::Valid(json::mesh::Mode::Triangles),
            targets: None,
            extensions: None,
            extras: json::Extras::default(),
        };
        let mesh = self.root.push(json::Mesh {
            name: Some(chunk.name.clone()),
            primitives: vec![primitive],
            weights: None,
            extensions: None,
            extras: json::Extras::default(),
        });
        let node = self.root.push(json::Node {
            name: Some(chunk.name.clone()),
            mesh: Some(mesh),
            translation: Some(chunk.origin),
            ..Default::default()
        });
        self.nodes.push(node);
        std::mem::take(&mut self.parts)
    }

    fn material(&mut self, chunk: &Chunk) -> json::Index<json::Material> {
        let view = self.view(chunk.jpeg.clone(), None);
        let image = self.root.push(json::Image {
            buffer_view: Some(view),
            mime_type: Some(json::image::MimeType("image/jpeg".to_owned())),
            name: Some(chunk.name.clone()),
            uri: None,
            extensions: None,
            extras: json::Extras::default(),
        });
        let texture = self.root.push(json::Texture {
            name: None,
            sampler: Some(self.sampler),
            source: image,
            extensions: None,
            extras: json::Extras::default(),
        });
        self.root.push(json::Material {
            name: Some(chunk.name.clone()),
            pbr_metallic_roughness: json::material::PbrMetallicRoughness {
                base_color_texture: Some(json::texture::Info {
                    index: texture,
                    tex_coord: 0,
                    extensions: None,
                    extras: json::Extras::default(),
                }),
                metallic_factor: json::material::StrengthFactor(0.0),
                roughness_factor: json::material::StrengthFactor(1.0),
                ..Default::default()
            },
            extensions: Some(json::extensions::material::Material {
                unlit: Some(json::extensions::material::Unlit {}),
            }),
            ..Default::default()
        })
    }

    /// Adds an attribute; `bounded`: with its extent, which the format demands of positions.
    fn vectors<const N: usize>(
        &mut self,
        vertices: &[Vertex],
        of: impl Fn(&Vertex) -> [f32; N],
        bounded: bool,
    ) -> json::Index<json::Accessor> {
        let values: Vec<[f32; N]> = vertices.iter().map(of).collect();
        let bytes = values.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
        let view = self.view(bytes, Some(json::buffer::Target::ArrayBuffer));
        let extreme = |pick: fn(f32, f32) -> f32, start: f32| -> Option<serde_json::Value> {
            bounded.then(|| {
                let ends: Vec<f32> =
                    (0..N).map(|axis| values.iter().map(|value| value[axis]).fold(start, pick)).collect();
                value!(ends)
            })
        };
        let kind = if N == 2 { json::accessor::Type::Vec2 } else { json::accessor::Type::Vec3 };
        self.root.push(json::Accessor {
            min: extreme(f32::min, f32::INFINITY),
            max: extreme(f32::max, f32::NEG_INFINITY),
            ..accessor(view, values.len(), json::accessor::ComponentType::F32, kind)
        })
    }

    fn indices(&mut self, indices: &[u32]) -> json::Index<json::Accessor> {
        let bytes = indices.iter().flat_map(|index| index.to_le_bytes()).collect();
        let view = self.view(bytes, Some(json::buffer::Target::ElementArrayBuffer));
        let kind = json::accessor::Type::Scalar;
        self.root.push(accessor(view, indices.len(), json::accessor::ComponentType::U32, kind))
    }

    fn view(&mut self, mut bytes: Vec<u8>, target: Option<json::buffer::Target>) -> json::Index<json::buffer::View> {
        let view = self.root.push(json::buffer::View {
            buffer: self.buffer,
            byte_length: USize64(bytes.len() as u64),
            byte_offset: Some(USize64(self.length)),
            byte_stride: None,
            name: None,
            target: target.map(Checked::Valid),
            extensions: None,
            extras: json::Extras::default(),
        });
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        self.length += bytes.len() as u64;
        self.parts.push(bytes);
        view
    }

    /// The description as text.
    fn finish(mut self) -> Result<Vec<u8>, ModelError> {
        for buffer in &mut self.root.buffers {
            buffer.byte_length = USize64(self.length);
        }
        let scene = self.root.push(json::Scene {
            name: Some("tunnel".to_owned()),
            nodes: self.nodes,
            extensions: None,
            extras: json::Extras::default(),
        });
        self.root.scene = Some(scene);
        Ok(self.root.to_vec()?)
    }
}

fn accessor(
    view: json::Index<json::buffer::View>,
    count: usize,
    component: json::accessor::ComponentType,
    kind: json::accessor::Type,
) -> json::Accessor {
    json::Accessor {
        buffer_view: Some(view),
        byte_offset: None,
        count: USize64(count as u64),
        component_type: Checked::Valid(json::accessor::GenericComponentType(component)),
        type_: Checked::Valid(kind),
        min: None,
        max: None,
        name: None,
        normalized: false,
        sparse: None,
        extensions: None,
        extras: json::Extras::default(),
    }
}

#[cfg(test)]
mod tests {
    use json::validation::Validate;

    use super::*;

    fn chunk(name: &str) -> Chunk {
        let vertex = |x: f32, y: f32| Vertex { position: [x, y, 0.0], normal: [0.0, 0.0, 1.0], uv: [x, y] };
        Chunk {
            name: name.to_owned(),
            origin: [0.0, 0.0, -5.0],
            vertices: vec![vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(0.0, 1.0)],
            indices: vec![0, 1, 2],
            jpeg: vec![0xff, 0xd8, 1, 2, 3],
        }
    }

    fn word(bytes: &[u8], at: usize) -> u32 {
        u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
    }

    #[test]
    fn the_file_is_framed_and_described_as_the_format_demands() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.glb");
        let mut writer = Box::new(GlbWriter::create(&path).unwrap());
        for name in ["a", "b"] {
            writer.add(&chunk(name)).unwrap();
        }
        writer.finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!((&bytes[..4], word(&bytes, 4), word(&bytes, 8) as usize), (&b"glTF"[..], 2, bytes.len()));
        let text_length = word(&bytes, 12) as usize;
        assert_eq!((&bytes[16..20], text_length % 4), (&b"JSON"[..], 0));
        let binary_at = 20 + text_length;
        assert_eq!(&bytes[binary_at + 4..binary_at + 8], b"BIN\0");
        let binary = &bytes[binary_at + 8..];
        assert_eq!(word(&bytes, binary_at) as usize, binary.len());

        let root = json::Root::from_slice(&bytes[20..binary_at]).unwrap();
        let mut faults = Vec::new();
        root.validate(&root, json::Path::new, &mut |path, error| faults.push(format!("{}: {error:?}", path())));
        assert!(faults.is_empty(), "{faults:?}");
        assert_eq!(root.buffers[0].byte_length.0 as usize, binary.len());
        for view in &root.buffer_views {
            assert!(view.byte_offset.unwrap().0 % 4 == 0);
            assert!(view.byte_offset.unwrap().0 + view.byte_length.0 <= binary.len() as u64);
        }
        let picture = &root.buffer_views[root.images[1].buffer_view.unwrap().value()];
        let start = picture.byte_offset.unwrap().0 as usize;
        assert_eq!(binary[start..start + picture.byte_length.0 as usize], [0xff, 0xd8, 1, 2, 3]);
        assert_eq!(root.nodes[1].translation, Some([0.0, 0.0, -5.0]));
    }
}
