set(report_SOURCES blocks.cpp colors.cpp embedded_page.cpp pictures_json.cpp plot_area.cpp raster.cpp report_json.cpp svg.cpp svg_marks.cpp
    write_report.cpp)
