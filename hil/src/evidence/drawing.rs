//! What the pictures share: text, colours, and the way from a drawing to SVG text.

use anyhow::{Result, anyhow};
use plotters::chart::MeshStyle;
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

/// A part of a picture.
pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// What a drawing function returns.
pub(super) type DrawResult = std::result::Result<(), Box<dyn std::error::Error>>;

/// Text and points.
pub(super) const TEXT: RGBColor = RGBColor(34, 40, 49);
/// Less important text, axes.
pub(super) const MUTED: RGBColor = RGBColor(110, 118, 128);
/// Grid.
const GRID: RGBColor = RGBColor(222, 226, 231);
/// A curve.
pub(super) const LINE: RGBColor = RGBColor(0, 90, 156);
/// A limit, and what lies beyond.
pub(super) const AT_LIMIT: RGBColor = RGBColor(192, 57, 43);

const FONT: &str = "Helvetica, Arial, DejaVu Sans, sans-serif";

/// Drawing units of a pixel: the backend places everything on whole units.
pub(super) const SCALE: i32 = 8;

/// A length in pixels as drawing units.
pub(super) fn px(pixels: i32) -> i32 {
    SCALE * pixels
}

/// Text of a height in pixels.
pub(super) fn text_style(height: i32, color: &RGBColor) -> TextStyle<'static> {
    (FONT, px(height)).into_font().color(color)
}

/// Grid, axes and text of every chart.
pub(super) fn chart_style(mesh: &mut MeshStyle<'_, '_, RangedCoordf64, RangedCoordf64, SVGBackend<'_>>) {
    mesh.light_line_style(TRANSPARENT)
        .bold_line_style(GRID.stroke_width(SCALE as u32))
        .axis_style(MUTED.stroke_width(SCALE as u32))
        .set_all_tick_mark_size(px(5))
        .label_style(text_style(14, &TEXT))
        .axis_desc_style(text_style(15, &TEXT));
}

/// A picture of a size in pixels, as SVG text.
///
/// # Errors
/// When it cannot be drawn.
pub(super) fn svg(size: (i32, i32), draw: impl FnOnce(&Area<'_>) -> DrawResult) -> Result<String> {
    let mut text = String::new();
    {
        let root =
            SVGBackend::with_string(&mut text, (px(size.0) as u32, px(size.1) as u32)).into_drawing_area();
        root.fill(&WHITE)?;
        draw(&root).map_err(|e| anyhow!("cannot draw: {e}"))?;
    }
    // The view box stays; the picture's own size is that of the page.
    let fine = format!("width=\"{}\" height=\"{}\"", px(size.0), px(size.1));
    Ok(text.replacen(&fine, &format!("width=\"{}\" height=\"{}\"", size.0, size.1), 1))
}
