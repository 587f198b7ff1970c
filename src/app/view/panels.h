// The panels of the right column, one file each.
#pragma once

#include <imgui.h>

#include <string>
#include <string_view>

#include "src/app/view/ui.h"

namespace trex {

void cameraPanel(Ui& ui);
void materialsPanel(Ui& ui);
void lightsPanel(Ui& ui);
void objectsPanel(Ui& ui);
void viewPanel(Ui& ui);
void sectionPanel(Ui& ui);
void editsPanel(Ui& ui);
void statusPanel(Ui& ui);

/// Whether `name` has all of `search` in it, case ignored.
bool matches(std::string_view name, std::string_view search);
/// A name to show: itself, or "material 3" if it has none.
std::string shownName(const std::string& name, const char* kind, std::size_t number);

/// A line of a form: the label in the left third, the next widget in the rest.
void label(const char* text, const char* tip = nullptr);
/// A box to type a search into.
void searchBox(const char* hint, std::string& text);
/// A slider that takes the column's width; true if it was moved. `logarithmic` for wide ranges.
bool slider(const char* text, float& value, float low, float high, const char* format = "%.3f",
            bool logarithmic = false, const char* tip = nullptr);
/// A colour with its picker.
bool colorBox(const char* text, float* rgb, const char* tip = nullptr);
/// Three coordinates in metres; dragging moves by thousandths of `size`.
bool pointBox(const char* text, dvec3& point, double size);
bool checkBox(const char* text, bool& value, const char* tip = nullptr);
/// A line of text in the weaker colour.
void weakText(const std::string& text);
/// A figure with its name.
void figure(const char* name, const std::string& value, const char* tip = nullptr);
void heading(const char* text);
/// Shows a tip over the last widget.
void tip(const char* text);

}  // namespace trex
