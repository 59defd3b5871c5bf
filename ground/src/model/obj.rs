//! model.obj with model.mtl and a folder of JPEG textures, for programs that do not read glTF. Same frame as the GLB.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::ChunkSink;
use super::error::{ModelError, at_path};
use super::mesh::Chunk;

/// The meshes.
const OBJ: &str = "model.obj";
/// The materials.
const MTL: &str = "model.mtl";
/// Folder of the textures, beside the OBJ.
const TEXTURES: &str = "model_textures";

/// Writes `model.obj`, `model.mtl` and `model_textures/` chunk by chunk.
pub(super) struct ObjWriter {
    out: PathBuf,
    meshes: BufWriter<File>,
    materials: BufWriter<File>,
    /// Number of the next vertex.
    next: u32,
}

impl ObjWriter {
    /// Prepares the files below `out`.
    pub(super) fn create(out: &Path) -> Result<Self, ModelError> {
        let textures = out.join(TEXTURES);
        if textures.exists() {
            fs::remove_dir_all(&textures).map_err(at_path(&textures))?;
        }
        fs::create_dir_all(&textures).map_err(at_path(&textures))?;
        let create = |name: &str| {
            let path = out.join(name);
            File::create(&path).map(BufWriter::new).map_err(at_path(&path))
        };
        let mut writer = Self { out: out.to_owned(), meshes: create(OBJ)?, materials: create(MTL)?, next: 1 };
        let title = "# Metres; x right, y up, -z forward along the tunnel (tunnel frame: y, -z, -x).";
        writeln!(writer.meshes, "{title}\nmtllib {MTL}").map_err(at_path(&out.join(OBJ)))?;
        Ok(writer)
    }

    fn material(&mut self, name: &str) -> io::Result<()> {
        // illum 0: the colour as it is, without light.
        writeln!(self.materials, "newmtl {name}\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 0\nmap_Kd {TEXTURES}/{name}.jpg\n")
    }

    fn mesh(&mut self, chunk: &Chunk) -> io::Result<()> {
        let file = &mut self.meshes;
        writeln!(file, "o {0}\nusemtl {0}", chunk.name)?;
        for vertex in &chunk.vertices {
            let [x, y, z] =
                std::array::from_fn(|axis| f64::from(vertex.position[axis]) + f64::from(chunk.origin[axis]));
            writeln!(file, "v {x:.5} {y:.5} {z:.5}")?;
        }
        for vertex in &chunk.vertices {
            // OBJ counts v from the lower edge of the picture.
            writeln!(file, "vt {:.6} {:.6}", vertex.uv[0], 1.0 - vertex.uv[1])?;
        }
        for vertex in &chunk.vertices {
            let [x, y, z] = vertex.normal;
            writeln!(file, "vn {x:.5} {y:.5} {z:.5}")?;
        }
        for triangle in chunk.indices.chunks_exact(3) {
            write!(file, "f")?;
            for &index in triangle {
                let number = index + self.next;
                write!(file, " {number}/{number}/{number}")?;
            }
            writeln!(file)?;
        }
        self.next += chunk.vertices.len() as u32;
        Ok(())
    }
}

impl ChunkSink for ObjWriter {
    fn add(&mut self, chunk: &Chunk) -> Result<(), ModelError> {
        let path = self.out.join(TEXTURES).join(format!("{}.jpg", chunk.name));
        fs::write(&path, &chunk.jpeg).map_err(at_path(&path))?;
        self.material(&chunk.name).map_err(at_path(&self.out.join(MTL)))?;
        self.mesh(chunk).map_err(at_path(&self.out.join(OBJ)))
    }

    fn finish(mut self: Box<Self>) -> Result<(), ModelError> {
        self.materials.flush().map_err(at_path(&self.out.join(MTL)))?;
        self.meshes.flush().map_err(at_path(&self.out.join(OBJ)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::mesh::Vertex;
    use super::*;

    #[test]
    fn numbers_go_on_from_chunk_to_chunk_and_textures_lie_beside() {
        let vertex = Vertex { position: [1.0, 2.0, -0.5], normal: [0.0, 1.0, 0.0], uv: [0.25, 0.25] };
        let chunk = |name: &str| Chunk {
            name: name.to_owned(),
            origin: [0.0, 0.0, -3.0],
            vertices: vec![vertex; 3],
            indices: vec![0, 1, 2],
            jpeg: vec![1],
        };
        let folder = tempfile::tempdir().unwrap();
        let mut writer = Box::new(ObjWriter::create(folder.path()).unwrap());
        for name in ["a", "b"] {
            writer.add(&chunk(name)).unwrap();
        }
        writer.finish().unwrap();
        let text = fs::read_to_string(folder.path().join("model.obj")).unwrap();
        assert!(text.contains("v 1.00000 2.00000 -3.50000") && text.contains("vt 0.250000 0.750000"), "{text}");
        assert!(text.contains("f 1/1/1 2/2/2 3/3/3") && text.contains("f 4/4/4 5/5/5 6/6/6"), "{text}");
        let materials = fs::read_to_string(folder.path().join("model.mtl")).unwrap();
        assert!(materials.contains("map_Kd model_textures/b.jpg"));
        assert!(folder.path().join("model_textures/b.jpg").is_file());
    }
}
