//! The table as Parquet.

use super::{COLUMNS, Cells, Row, Table};
use parquet::basic::{LogicalType, Repetition, Type as Kind};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::Result;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;
use std::sync::Arc;

/// Rows in a row group, the unit that readers load: some 100 s at 100 frame sets per second.
const GROUP: usize = 10_000;

impl Table {
    /// Encodes the table as a Parquet file with the columns of [`csv`](super::csv): INT64 for whole
    /// numbers, optional DOUBLE for others, UTF-8 for words.
    ///
    /// # Errors
    /// If the library refuses the table.
    pub fn parquet(&self) -> Result<Vec<u8>> {
        let fields = COLUMNS.iter().map(|(name, cells)| field(name, cells));
        let fields = fields.collect::<Result<Vec<_>>>()?;
        let schema = Type::group_type_builder("measurements").with_fields(fields);
        let program = concat!("trinocular ", env!("CARGO_PKG_VERSION"));
        let properties = WriterProperties::builder().set_created_by(program.to_owned());
        let (schema, properties) = (Arc::new(schema.build()?), Arc::new(properties.build()));
        let mut bytes = Vec::new();
        let mut writer = SerializedFileWriter::new(&mut bytes, schema, properties)?;
        for rows in self.rows.chunks(GROUP) {
            let mut group = writer.next_row_group()?;
            for (_, cells) in &COLUMNS {
                column(&mut group, cells, rows)?;
            }
            group.close()?;
        }
        writer.close()?;
        Ok(bytes)
    }
}

fn field(name: &str, cells: &Cells) -> Result<Arc<Type>> {
    let (kind, repetition, logical) = match cells {
        Cells::Whole(_) => (Kind::INT64, Repetition::REQUIRED, None),
        Cells::Number(_) => (Kind::DOUBLE, Repetition::OPTIONAL, None),
        Cells::Text(_) | Cells::Quoted(_) => {
            let text = Some(LogicalType::String);
            (Kind::BYTE_ARRAY, Repetition::REQUIRED, text)
        }
    };
    let builder = Type::primitive_type_builder(name, kind).with_repetition(repetition);
    Ok(Arc::new(builder.with_logical_type(logical).build()?))
}

fn column<W: std::io::Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    cells: &Cells,
    rows: &[Row],
) -> Result<()> {
    let Some(mut column) = group.next_column()? else {
        return Ok(());
    };
    match cells {
        Cells::Whole(cell) => {
            let values: Vec<i64> = rows.iter().map(cell).collect();
            column
                .typed::<Int64Type>()
                .write_batch(&values, None, None)?;
        }
        Cells::Number(cell) => {
            let values: Vec<Option<f64>> = rows.iter().map(cell).collect();
            // A definition level of zero is an empty cell.
            let levels: Vec<i16> = values
                .iter()
                .map(|value| i16::from(value.is_some()))
                .collect();
            let values: Vec<f64> = values.into_iter().flatten().collect();
            let column = column.typed::<DoubleType>();
            column.write_batch(&values, Some(&levels), None)?;
        }
        Cells::Text(cell) | Cells::Quoted(cell) => {
            let values: Vec<ByteArray> = rows.iter().map(|row| cell(row).into()).collect();
            let column = column.typed::<ByteArrayType>();
            column.write_batch(&values, None, None)?;
        }
    }
    column.close()
}
